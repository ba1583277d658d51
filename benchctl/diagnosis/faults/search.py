"""Search for data faults that are visible in the output itself, before any fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchctl.diagnosis.faults.clipping import rail_in
from benchctl.diagnosis.faults.coarse import coarse_in, stairs_in
from benchctl.diagnosis.faults.dropouts import holds_in, repeats_in, rows_per_value
from benchctl.diagnosis.faults.fault import FoundFaults
from benchctl.diagnosis.faults.grid import grid_of
from benchctl.diagnosis.faults.standing import Output, standing_runs
from benchctl_instruments.arrays import BoolArray, FloatArray

_LEAST_STEP_V = 1e-9
"""Replaces a step of zero."""


def faults_in(
    *,
    volts: FloatArray,
    predicted: FloatArray,
    foretold: BoolArray,
    stretches: Sequence[slice],
    interval_s: float,
    adc_step_v: float,
    limit_v: float = np.inf,
) -> FoundFaults:
    """Find lost bits, rails and held samples in an output (n,) before any fit; the masked rows must not be fitted.

    `predicted` (n,) is the output by the unchanged model of the lab: it is used only to see where the output should
    have changed, and only where `foretold` (n,) is true. `stretches` are the rows without gaps, `adc_step_v` the
    converter's step (0: unknown), `limit_v` the rated limit of the output; rows at this limit are ignored.

    Spikes require a residual: call `spikes_in` after a provisional fit without the rows that are `masked` here.
    """
    alive = np.isfinite(volts) & (np.abs(volts) < limit_v) & np.isfinite(predicted)
    grid = grid_of(volts[alive], adc_step_v)
    residual = np.where(alive, volts - predicted, 0.0)
    output = Output(
        volts=volts,
        predicted=predicted,
        alive=alive,
        foretold=foretold,
        stretches=stretches,
        step_v=max(grid.step_v, _LEAST_STEP_V),
        noise_v=quiet_noise_v(residual, predicted, interval_s, grid.step_v),
    )
    rows = rows_per_value(output)
    output = replace(output, rows_per_value=rows)
    runs = standing_runs(output)
    rail, at_rail = rail_in(output, runs)
    railed = np.zeros_like(alive) if rail is None else rail.rows
    holds = holds_in(output, runs.where(~at_rail), railed, interval_s)
    stairs = stairs_in(output, interval_s)
    lost = coarse_in(output, grid, adc_step_v, stairs)
    found = tuple(one for one in (lost, rail, holds) if one is not None)
    standing = railed if holds is None else railed | holds.rows
    masked = stairs | standing
    if rows > 1:
        masked |= repeats_in(output, rows)
    return FoundFaults(found=found, masked=masked, standing=standing, step_v=grid.step_v, rows_per_value=rows)


_WINDOW_S = 1.0
_INNER = 0.4
"""Distance from the middle of the prediction's range, over the range, within which no rail is expected."""
_QUIETEST = 0.1
"""Share of windows that may be quieter: those in which the output is held or at a rail."""


def quiet_noise_v(residual: FloatArray, predicted: FloatArray, interval_s: float, step_v: float) -> float:
    """Return a lower estimate of the noise deviation before the converter [V]; 0 if its steps hide the noise.

    It is a low quantile of the differences of successive residuals (n,) in windows of one second. Slow model errors
    have no influence; fast ones make windows louder. Rounding adds step²/12 if noise or motion exceed a step; quieter
    windows show stairs. Windows in which the prediction (n,) rests, far from where a rail may be, have a quantile of
    their own: noise that only motion makes gives no information about equal values at rest.
    """
    window = max(2, round(_WINDOW_S / interval_s))
    windows = residual.size // window
    if windows == 0:
        return 0.0

    def by_window(values: FloatArray) -> FloatArray:
        return values[: windows * window].reshape(windows, window)

    power = np.mean(np.diff(by_window(residual), axis=1) ** 2, axis=1)
    expected, low, high = by_window(predicted), np.nanmin(predicted), np.nanmax(predicted)
    inner = np.abs(expected.mean(axis=1) - 0.5 * (low + high)) < _INNER * (high - low)
    rests = inner & (np.ptp(expected, axis=1) < step_v / 2.0)
    quietest = min(float(np.quantile(one, _QUIETEST)) for one in (power, power[rests]) if one.size)
    return math.sqrt(max(quietest / 2.0 - step_v**2 / 12.0, 0.0))
