"""The size of each effect on a plausible unit, and the parameters at a share of that size.

Sizes are drawn uniformly in the logarithm, with either sign if the effect has one. Rates are shares of the unit's
range; voltages are shares of its full scale or of its noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Protocol

import numpy as np

from benchctl_instruments.physics.effects.registry import effect
from benchctl_instruments.physics.gyro import GyroParameters

if TYPE_CHECKING:
    from benchctl.proof.unit import TrialUnit  # its import needs a bench file; sizes do not

Values = dict[str, float]


class Sized(Protocol):
    """The properties of a unit that determine the sizes of its effects."""

    @property
    def gyro(self) -> GyroParameters:
        """The gyro."""

    @property
    def range_dps(self) -> float:
        """The rated range."""

    @property
    def full_scale_v(self) -> float:
        """The output's change at the rated range."""

    @property
    def noise_v(self) -> float:
        """The noise of a sample."""

    @property
    def sample_rate_hz(self) -> float:
        """Samples per second."""

    @property
    def adc_step_v(self) -> float:
        """The step of the converter."""


WARM_C = 40.0
"""Distance from T0 that every run reaches [°C]."""

RAMP_C_PER_S = 0.08
"""Rate of change of the housing's temperature during a ramp [°C/s]."""


class _Draw:
    """A random source with the distributions that `_DRAWS` uses."""

    def __init__(self, rng: np.random.Generator, unit: Sized) -> None:
        self.rng, self.unit = rng, unit
        self.full_v, self.range_dps, self.noise_v = unit.full_scale_v, unit.range_dps, unit.noise_v

    def about(self, low: float, high: float) -> float:
        return float(np.exp(self.rng.uniform(math.log(low), math.log(high))))

    def either(self, low: float, high: float) -> float:
        return self.about(low, high) * float(self.rng.choice((-1.0, 1.0)))

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def one_of(self, *choices: float) -> float:
        return float(self.rng.choice(choices))


def _turning(draw: _Draw, size: str, largest: float) -> Values:
    order = draw.one_of(1, 1, 2)
    return {size: largest, "phase_deg": draw.between(0.0, 360.0 / order), "order": order}


_DRAWS: Mapping[str, Callable[[_Draw], Values]] = {
    "rate_nonlinearity": lambda d: {
        "c2": d.either(0.02, 0.06) / d.range_dps**2,
        "c4": d.either(0.008, 0.025) / d.range_dps**4,
    },
    "scale_temperature": lambda d: {"a1": d.either(6e-5, 3e-4), "a2": d.either(5e-7, 2.5e-6)},
    "scale_asymmetry": lambda d: {"fraction": d.either(5e-4, 4e-3)},
    "scale_rate_temperature_coupling": lambda d: {
        "coefficient": d.either(1e-3, 5e-3) / (WARM_C * d.range_dps**2),
    },
    "scale_warm_up": lambda d: {"fraction": d.either(2e-3, 8e-3), "tau_s": d.about(200.0, 900.0)},
    "scale_ageing": lambda d: {"per_hour": d.either(1e-3, 8e-3)},
    "thermal_hysteresis": lambda d: {
        "width_c": (width := d.about(2.0, 9.0)),
        "fraction_per_c": d.either(6e-4, 2.5e-3) / width,
    },
    "saturation": lambda d: {"limit_v": _rail(d)},
    "two_rails": lambda d: {"lower_v": -_rail(d), "upper_v": _rail(d)},
    "dead_zone": lambda d: {"half_width_dps": d.about(0.05, 0.5)},
    "rate_squared": lambda d: {"v_per_dps2": d.full_v * d.either(5e-4, 4e-3) / d.range_dps**2},
    "fringe_ambiguity": lambda d: {"fold_dps": d.range_dps * (1.0 - d.between(0.05, 0.25))},
    "overload": lambda d: {
        "onset_dps": d.range_dps * (1.0 - d.between(0.06, 0.25)),
        "loss_v_per_dps": d.full_v / d.range_dps * d.between(1.2, 1.7),
    },
    "bias_temperature": lambda d: {
        "c1_v_per_c": d.full_v * d.either(8e-4, 4e-3) / WARM_C,
        "c2_v_per_c2": d.full_v * d.either(5e-4, 2e-3) / WARM_C**2,
    },
    "bias_temperature_rate": lambda d: {"v_per_c_per_s": d.full_v * d.either(5e-4, 3e-3) / RAMP_C_PER_S},
    "warm_up": lambda d: {"amplitude_v": d.full_v * d.either(5e-4, 3e-3), "tau_s": d.about(150.0, 900.0)},
    "bias_drift": lambda d: {"v_per_hour": d.full_v * d.either(5e-4, 3e-3)},
    "bias_random_walk": lambda d: {"v_per_sqrt_s": d.noise_v * d.about(0.04, 0.25)},
    "flicker_noise": lambda d: {"v_rms_per_decade": d.noise_v * d.about(0.15, 0.6)},
    "heading_dependent_bias": lambda d: _turning(d, "amplitude_v", d.full_v * d.about(2e-4, 1.2e-3)),
    "thermal_lag": lambda d: {"tau_s": d.about(200.0, 900.0)},
    "angular_acceleration": lambda d: {"v_per_dps2": d.full_v / d.range_dps * d.either(1e-3, 6e-3)},
    "mount_resonance": lambda d: {"frequency_hz": d.about(14.0, 40.0), "damping": d.about(0.03, 0.2)},
    "sensor_bandwidth": lambda d: {"cutoff_hz": d.about(12.0, 40.0), "order": d.one_of(1, 2)},
    "mains_pickup": lambda d: {
        "amplitude_v": d.noise_v * d.about(0.3, 2.0),
        "frequency_hz": d.between(11.0, 0.47 * d.unit.sample_rate_hz),
        "phase_deg": d.between(0.0, 360.0),
    },
    "adc_nonlinearity": lambda d: {
        "inl_v": d.noise_v * d.about(1.0, 5.0),
        "period_v": d.full_v * d.between(0.15, 1.0),
    },
    "adc_coarse": lambda d: {"bits_lost": _bits_under_the_noise(d) + d.one_of(2, 3, 4)},
    "timing_offset": lambda d: {"offset_s": d.either(1.5e-3, 1e-2)},
    "clock_drift": lambda d: {"ppm": d.either(8.0, 80.0)},
    "encoder_eccentricity": lambda d: _turning(d, "amplitude_arcsec", d.about(30.0, 120.0)),
    "encoder_interpolation": lambda d: {
        "amplitude_arcsec": d.about(1.0, 6.0),
        "lines_per_rev": d.one_of(2048, 3600, 5000, 9000),
    },
    "outliers": lambda d: {"fraction": d.about(2e-4, 2e-3), "scale_v": d.noise_v * d.about(40.0, 400.0)},
    "dropouts": lambda d: {"count": d.one_of(*range(5, 20)), "hold_s": d.between(0.3, 2.0)},
    "noise_rate_dependent": lambda d: {"factor_at_full_rate": 1.0 + d.about(0.4, 2.5)},
}

DRAWN = tuple(name for name in _DRAWS if name != "overload")
"""Every effect of the vocabulary except `supply_sensitivity` and `overload`.

The simulated bench records no supply voltage, and a diagnosis searches for an overload in static points only.
"""

WANDERING = ("bias_random_walk", "flicker_noise")

STATISTICAL = frozenset({*WANDERING, "outliers", "dropouts", "noise_rate_dependent", "adc_coarse"})
"""Effects whose change of the output does not follow from their parameters; they are drawn at full size only."""

_SHRUNK: Mapping[str, Callable[[Values, float, TrialUnit], Values]] = {
    "thermal_lag": lambda v, share, unit: {"tau_s": share * v["tau_s"]},
    "sensor_bandwidth": lambda v, share, unit: {**v, "cutoff_hz": v["cutoff_hz"] / share},
    # below the resonance the relative error of the rate is (f / f_mount)²
    "mount_resonance": lambda v, share, unit: {**v, "frequency_hz": v["frequency_hz"] / math.sqrt(share)},
    "saturation": lambda v, share, unit: {"limit_v": _nearer(v["limit_v"], unit.full_scale_v * _top(unit), share)},
    "two_rails": lambda v, share, unit: {
        name: math.copysign(_nearer(abs(rail), unit.full_scale_v * _top(unit), share), rail) for name, rail in v.items()
    },
    "fringe_ambiguity": lambda v, share, unit: {"fold_dps": _nearer(v["fold_dps"], unit.range_dps, share)},
}


def drawn_size(identifier: str, rng: np.random.Generator, unit: Sized) -> Values:
    """Draw the parameters of an effect at full size."""
    return _DRAWS[identifier](_Draw(rng, unit))


def shrunk(identifier: str, values: Values, share: float, unit: TrialUnit) -> Values:
    """Return the parameters of the same effect at a share of its size."""
    if identifier in _SHRUNK:
        return _SHRUNK[identifier](values, share, unit)
    described = effect(identifier).parameters
    return {name: share * value if described[name].role == "size" else value for name, value in values.items()}


def _nearer(value: float, gone: float, share: float) -> float:
    return gone - share * (gone - value)


def _rail(draw: _Draw) -> float:
    """Draw a limit of the output that is below the output at the rated range."""
    return draw.full_v * (1.0 - draw.between(0.06, 0.25)) * _top(draw.unit)


def _top(unit: Sized) -> float:
    """Return the output of the interferometer's sine at the rated range, relative to that of a straight line."""
    phase = unit.gyro.S_rad_per_dps * unit.range_dps
    return math.sin(phase) / phase


def _bits_under_the_noise(draw: _Draw) -> float:
    """Return how many bits may be lost before a step is as large as the noise."""
    return max(0.0, math.floor(math.log2(draw.noise_v / draw.unit.adc_step_v)))
