"""From volts and temperature to a rate, at every level of compensation."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from benchctl.calibration.model import Law, factor
from benchctl.calibration.result import Stage, StraightLine
from benchctl.calibration.rows import Rows
from benchctl_instruments.arrays import FloatArray

Compensator = Callable[[FloatArray, FloatArray], FloatArray]
"""Output [V] and T − T0 [°C], of one shape, to the sensed rate [°/s]."""


def by_line(line: StraightLine) -> Compensator:
    """One straight line."""
    return lambda volts, dt_c: (volts - line.U0_v) / line.K0_v_per_dps


def by_stages(stages: Sequence[Stage]) -> Compensator:
    """The two-stage correction: the last stage's K0 and U0, then every stage's factors, each of that stage's input."""

    def compensate(volts: FloatArray, dt_c: FloatArray) -> FloatArray:
        last = stages[-1]
        rate = (volts - last.U0_v - bias(last.u0_t, dt_c)) / last.K0_v_per_dps
        for stage in stages:
            rate = rate * factor(stage.k_t.coefficients, dt_c) * factor(stage.k_omega.coefficients, rate**2)
        return rate

    return compensate


def by_law(law: Law, parameters: FloatArray, U0_v: float, u0_t: Sequence[float]) -> Compensator:
    """A law of the joint fit; `parameters` are the law's own, in its order."""
    return lambda volts, dt_c: law.rate(parameters, volts - U0_v - bias(u0_t, dt_c), dt_c)


def bias(coefficients: Sequence[float], dt_c: FloatArray) -> FloatArray:
    """c1·ΔT + c2·ΔT² + …, V."""
    return factor(coefficients, dt_c) - 1.0


def mean_rate(compensate: Compensator, rows: Rows) -> FloatArray:
    """Mean over each block of the compensated rate, °/s: the law curves the motion within the block, too."""
    nudge = np.maximum(1e-5, 1e-4 * np.abs(rows.output_v))
    up, down = compensate(rows.output_v + nudge, rows.dt_c), compensate(rows.output_v - nudge, rows.dt_c)
    slope = (up - down) / (2 * nudge)
    spread_v = rows.spread_dps / np.where(slope == 0.0, np.inf, slope)
    high, low = compensate(rows.output_v + spread_v, rows.dt_c), compensate(rows.output_v - spread_v, rows.dt_c)
    return np.asarray(0.5 * (high + low))
