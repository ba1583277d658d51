"""The gyro's answer in volts to what it feels, before its electronics: U = U0 + K0·k(T)·k(ω)·ω and every effect."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.benchctl.diagnosis.foreign.felt import Felt
from tests.benchctl.diagnosis.foreign.linear import FloatArray
from tests.benchctl.diagnosis.foreign.truth import Effects
from tests.benchctl.diagnosis.foreign.unit import Unit

Number = dict[str, float]
Term = Callable[[Felt, FloatArray, Number], FloatArray]
"""A term of the scale or of the bias, from what is felt, the rate that the coil answers to, and its numbers."""

_SCALE: dict[str, Term] = {
    "rate_nonlinearity": lambda f, w, p: p["c2"] * w**2 + p["c4"] * w**4,
    "scale_temperature": lambda f, w, p: p["a1"] * f.warmer_c + p["a2"] * f.warmer_c**2,
    "scale_asymmetry": lambda f, w, p: 0.5 * p["fraction"] * np.sign(w),
    "scale_rate_temperature_coupling": lambda f, w, p: p["coefficient"] * f.warmer_c * w**2,
    "scale_warm_up": lambda f, w, p: p["fraction"] * np.exp(-f.time_s / p["tau_s"]),
    "scale_ageing": lambda f, w, p: p["per_hour"] * f.time_s / 3600.0,
    "thermal_hysteresis": lambda f, w, p: p["fraction_per_c"] * f.slack_c,
    "supply_sensitivity": lambda f, w, p: p["fraction_per_v"] * f.supply_v,
}

_BIAS: dict[str, Term] = {
    "rate_squared": lambda f, w, p: p["v_per_dps2"] * w**2,
    "bias_temperature": lambda f, w, p: p["c1_v_per_c"] * f.warmer_c + p["c2_v_per_c2"] * f.warmer_c**2,
    "bias_temperature_rate": lambda f, w, p: p["v_per_c_per_s"] * f.warms_c_per_s,
    "warm_up": lambda f, w, p: p["amplitude_v"] * np.exp(-f.time_s / p["tau_s"]),
    "bias_drift": lambda f, w, p: p["v_per_hour"] * f.time_s / 3600.0,
    "heading_dependent_bias": lambda f, w, p: (
        p["amplitude_v"] * np.cos(np.deg2rad(p["order"] * (f.angle_deg - p["phase_deg"])))
    ),
    "angular_acceleration": lambda f, w, p: p["v_per_dps2"] * f.accel_dps2,
    "supply_sensitivity": lambda f, w, p: p["v_per_v"] * f.supply_v,
}


def answer(effects: Effects, unit: Unit, felt: Felt) -> FloatArray:
    """The output (V) on the grid of `felt`."""
    rate = _answered(effects, felt.rate_dps)
    scale = unit.k0_v_per_dps * _series(felt.warmer_c, unit.k_t) * _series(rate**2, unit.k_omega)
    bias = np.full_like(rate, unit.u0_v)
    for name, numbers in effects.items():
        if name in _SCALE:
            scale *= 1.0 + _SCALE[name](felt, rate, numbers)
        if name in _BIAS:
            bias += _BIAS[name](felt, rate, numbers)
    return bias + scale * rate


def _series(x: FloatArray, coefficients: tuple[float, ...]) -> FloatArray:
    """1 + a1·x + a2·x² + …"""
    total = np.zeros_like(x)
    for coefficient in reversed(coefficients):
        total = (total + coefficient) * x
    return total + 1.0


def _answered(effects: Effects, rate: FloatArray) -> FloatArray:
    """The rate that the scale factor is applied to: folded back beyond the ambiguity, shrunk by the dead zone."""
    if fold := effects.get("fringe_ambiguity"):
        size = np.abs(rate)
        rate = np.sign(rate) * np.where(size > fold["fold_dps"], 2.0 * fold["fold_dps"] - size, size)
    if zone := effects.get("dead_zone"):
        rate = np.sign(rate) * np.maximum(np.abs(rate) - zone["half_width_dps"], 0.0)
    return rate
