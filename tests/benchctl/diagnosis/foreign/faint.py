"""Effects at the edge of what a recording can tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.benchctl.diagnosis.foreign import encoder
from tests.benchctl.diagnosis.foreign.climate import Climate, weather
from tests.benchctl.diagnosis.foreign.linear import FloatArray
from tests.benchctl.diagnosis.foreign.make import clean_output
from tests.benchctl.diagnosis.foreign.motion import Motion, move
from tests.benchctl.diagnosis.foreign.plans import plan
from tests.benchctl.diagnosis.foreign.truth import Truth
from tests.benchctl.diagnosis.foreign.unit import nominal

_SIZE: dict[str, str] = {
    "rate_nonlinearity": "c2 c4",
    "scale_temperature": "a1 a2",
    "scale_asymmetry": "fraction",
    "scale_rate_temperature_coupling": "coefficient",
    "scale_warm_up": "fraction",
    "scale_ageing": "per_hour",
    "thermal_hysteresis": "fraction_per_c",
    "dead_zone": "half_width_dps",
    "rate_squared": "v_per_dps2",
    "bias_temperature": "c1_v_per_c c2_v_per_c2",
    "bias_temperature_rate": "v_per_c_per_s",
    "warm_up": "amplitude_v",
    "bias_drift": "v_per_hour",
    "heading_dependent_bias": "amplitude_v",
    "thermal_lag": "tau_s",
    "angular_acceleration": "v_per_dps2",
    "timing_offset": "offset_s",
    "clock_drift": "ppm",
    "encoder_eccentricity": "amplitude_arcsec",
}
"""The parameters in which an effect is linear where it is small."""

LINEAR = tuple(_SIZE)
"""Effects that can be made as faint as one likes."""


def scaled_to(gain: float, truth: Truth) -> Truth:
    """The same effect as small as makes it gain `gain` in twice the log-likelihood, where the file's noise is right.

    Both are read on the nominal unit: the change of the output that no refitted coefficient takes up, squared and
    summed, over the noise squared. The truth hides one effect, of `LINEAR`.
    """
    ((name, numbers),) = truth.effects.items()
    for _ in range(3):
        by = float(np.sqrt(gain / gained(replace(truth, effects={name: numbers}))))
        numbers = {key: value * by if key in _SIZE[name].split() else value for key, value in numbers.items()}
    return replace(truth, effects={name: numbers})


def gained(truth: Truth) -> float:
    """Twice the log-likelihood that all that `truth` conceals is worth, with the simulation's coefficients refitted."""
    bench, unit = truth.where, nominal(truth)
    steps = plan(bench.range_dps, truth.set_points)
    moved = move(steps, bench.sample_rate_hz, start_deg=0.0, cogging=unit.cogging, rng=np.random.default_rng(1))
    climate = weather(steps)
    at = moved.at_samples(bench.sample_rate_hz)
    without = replace(truth, effects={}, outsiders={})
    change = clean_output(truth, unit, moved, climate) - clean_output(without, unit, moved, climate)
    # An encoder that reads too much by e makes the rate it tells too large by e', and the gyro seems to answer less.
    error = encoder.angle_error(truth.effects, at.angle_deg, 0.0)
    change -= unit.k0_v_per_dps * np.gradient(error, at.dt_s)
    basis = _coefficients(truth, at, climate)
    taken_up, *_ = np.linalg.lstsq(basis, change, rcond=None)
    return float(np.sum((change - basis @ taken_up) ** 2) / bench.noise_v**2)


def _coefficients(truth: Truth, at: Motion, climate: Climate) -> FloatArray:
    """The output's change with each coefficient that the file's simulation has; shape (n, coefficients)."""
    rate, warmer = at.rate_dps, climate.at(climate.housing_c, at.time_s) - truth.where.t0_c
    columns = [rate, np.ones_like(rate)]
    if "k_T" not in truth.lacking:
        columns += [rate * warmer, rate * warmer**2]
    if "k_omega" not in truth.lacking:
        columns += [rate**3, rate**5]
    basis = np.column_stack(columns)
    return np.asarray(basis / np.abs(basis).max(axis=0), dtype=np.float64)
