"""Effects that the vocabulary does not have: a diagnosis must say that something is left, and in which coordinate."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.benchctl.diagnosis.foreign.climate import backlash
from tests.benchctl.diagnosis.foreign.felt import Felt
from tests.benchctl.diagnosis.foreign.linear import FloatArray
from tests.benchctl.diagnosis.foreign.truth import Effects
from tests.benchctl.diagnosis.foreign.unit import Unit

Number = dict[str, float]

_OUTSIDERS: dict[str, tuple[tuple[str, ...], Callable[[Felt, Number, float], FloatArray]]] = {
    # The output depends on whence the rate came, however slowly.
    "rate_hysteresis": (
        ("rate", "output", "rate_sign", "acceleration"),
        lambda f, p, k: k * p["fraction"] * (backlash(f.rate_dps, p["half_width_dps"]) - f.rate_dps),
    ),
    # A bias that grows with the square of the temperature's rate.
    "temperature_rate_squared": (
        ("gyro_temp_rate",),
        lambda f, p, k: p["v_per_c2_per_s2"] * f.warms_c_per_s**2,
    ),
    # A scale that depends on the angle, the more the warmer it is.
    "angle_by_temperature": (
        ("angle*gyro_temp", "angle", "angle*rate"),
        lambda f, p, k: (
            k * p["per_c"] * f.rate_dps * f.warmer_c * np.cos(np.deg2rad(p["order"] * f.angle_deg) + p["phase_rad"])
        ),
    ),
    # Rectified vibration: a bias with the square of the acceleration.
    "acceleration_squared": (("acceleration",), lambda f, p, k: p["v_per_dps2_2"] * f.accel_dps2**2),
    "acceleration_cubed": (("acceleration",), lambda f, p, k: p["v_per_dps2_3"] * f.accel_dps2**3),
    # Something happened once.
    "bump": (
        ("time", "step"),
        lambda f, p, k: p["amplitude_v"] * np.exp(-0.5 * ((f.time_s - p["at_s"]) / p["width_s"]) ** 2),
    ),
    # A bias that jumps at one moment and stays.
    "jump": (("time", "step"), lambda f, p, k: p["amplitude_v"] * np.heaviside(f.time_s - p["at_s"], 1.0)),
    # A bias that swings slowly and periodically in time.
    "swing": (("time",), lambda f, p, k: p["amplitude_v"] * np.sin(2.0 * np.pi * f.time_s / p["period_s"])),
    # A scale with a narrow dip at one temperature: a crystal's transition in the coil's glue.
    "temperature_dip": (
        ("gyro_temp", "gyro_temp*rate", "rate*gyro_temp"),
        lambda f, p, k: (
            k * p["fraction"] * f.rate_dps * np.exp(-0.5 * ((f.warmer_c - p["above_t0_c"]) / p["width_c"]) ** 2)
        ),
    ),
    # A wave in the response over the rate: interference inside the light source.
    "rate_wave": (
        ("rate", "abs_rate", "output"),
        lambda f, p, k: p["amplitude_v"] * np.sin(2.0 * np.pi * f.rate_dps / p["period_dps"] + p["phase_rad"]),
    ),
}

NAMES = tuple(_OUTSIDERS)


def lives_in(name: str) -> tuple[str, ...]:
    """The coordinates in which an outsider may rightly be located."""
    return _OUTSIDERS[name][0]


def add_outsiders(outsiders: Effects, output_v: FloatArray, felt: Felt, unit: Unit) -> FloatArray:
    """The output (V) with the outsiders added."""
    for name, numbers in outsiders.items():
        output_v = output_v + _OUTSIDERS[name][1](felt, numbers, unit.k0_v_per_dps)
    return output_v
