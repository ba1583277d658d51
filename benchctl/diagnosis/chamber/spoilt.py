"""Invalid readings of a chamber's thermometer: flagged as open, wrapped like a counter, or spikes."""

from __future__ import annotations

import math

import numpy as np

from benchctl.diagnosis.faults.fault import Fault, bounded_gain
from benchctl.diagnosis.faults.wrapping import EFFECT, wraps_in
from benchctl.diagnosis.result import Estimate
from benchctl.recordings.runs import holding
from benchctl_instruments.arrays import BoolArray, FloatArray

_AROUND = 4
"""Number of readings on either side that a reading is compared with: spikes are shorter."""
_USUAL, _NORMAL_USUAL = 0.9, 1.64485
"""Share of the readings assumed free of spikes, and the number of normal deviations that contains this share.

For a thermometer with coarse steps most readings equal their neighbours, so the median of the deviations is zero.
"""
_BEYOND = 12.0
"""Size of a spike: so many usual deviations, steps of the thermometer, and changes from reading to reading."""


def open_in(flags: FloatArray) -> tuple[Fault | None, BoolArray]:
    """Return the fault and the rows of readings (n,) with the thermometer's flag for an open circuit."""
    rows = np.nan_to_num(flags) > 0.5
    if not rows.any():
        return None, rows
    count = int(rows.sum())
    share = count / rows.size
    times = float(len(holding(rows)))
    return (
        Fault(
            effect="dropouts",
            parameters={"count": Estimate(value=times, low=times, high=times, unit="1")},
            rows=rows,
            gain=bounded_gain(math.inf),
            says=(
                f"The thermometer is flagged open in {count} of {rows.size} readings ({100.0 * share:.2g} %): these are"
                " left out."
            ),
        ),
        rows,
    )


def wrapped_in(read_c: FloatArray, known: BoolArray, step_c: float) -> tuple[Fault | None, BoolArray]:
    """Return the fault and the rows of readings [°C], (n,), that have left the counter range of the first reading.

    Readings `known` to be spoilt are ignored.
    """
    rows = np.zeros(read_c.size, np.bool_)
    wraps = wraps_in(read_c[~known], (slice(0, int((~known).sum())),), step_c)
    if wraps is None:
        return None, rows
    rows[~known] = wraps.turns != 0
    return (
        Fault(
            effect=EFFECT,
            parameters={"modulus_k": wraps.estimate("K")},
            rows=rows,
            gain=wraps.gain,
            says=(
                f"The thermometer wraps like a counter, {wraps.count} times, by {wraps.modulus:.6g} K, while the air"
                f" goes on: {int(rows.sum())} of {rows.size} readings are left out."
            ),
            coordinate="chamber_temp",
        ),
        rows,
    )


def spikes_in(
    read_c: FloatArray, known: BoolArray, step_c: float, runs: tuple[slice, ...]
) -> tuple[Fault | None, BoolArray]:
    """Return the fault and the rows of readings [°C], (n,), that differ from their neighbours on both sides.

    A reading is compared with the median of its neighbours, without those `known` to be spoilt. The air cannot jump up
    and down within a few readings; its usual deviation from that median is estimated from most of the readings.
    """
    away, moves = np.zeros(read_c.size), np.zeros(read_c.size)
    for run in runs:
        rows = run.start + np.flatnonzero(~known[run])
        if rows.size > 2 * _AROUND:
            padded = np.pad(read_c[rows], _AROUND, mode="reflect")
            around = np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1)
            away[rows] = read_c[rows] - np.median(around, axis=1)
            # where the air itself changes quickly, all neighbours change as much
            moves[rows] = np.median(np.abs(np.diff(around, axis=1)), axis=1)
    usual = float(np.quantile(np.abs(away[~known]), _USUAL)) / _NORMAL_USUAL if (~known).any() else 0.0
    rows = np.abs(away) > _BEYOND * np.maximum(moves, max(usual, step_c))
    if not rows.any():
        return None, rows
    count, heights = int(rows.sum()), away[rows]
    share, scale_k = count / rows.size, math.sqrt(float(np.mean(heights**2)))
    wide, wide_scale = 2.0 * math.sqrt(count) / rows.size, scale_k / math.sqrt(2.0 * count) * 2.0
    readings = read_c[rows]
    return (
        Fault(
            effect="outliers",
            parameters={
                "fraction": Estimate(value=share, low=max(share - wide, 0.0), high=share + wide, unit="1"),
                "scale_k": Estimate(
                    value=scale_k, low=max(scale_k - wide_scale, 0.0), high=scale_k + wide_scale, unit="K"
                ),
            },
            rows=rows,
            gain=bounded_gain(0.5 * float(np.sum((heights / max(usual, step_c, 1e-9)) ** 2))),
            says=(
                f"{count} of {rows.size} readings of the thermometer are spikes, between {float(readings.min()):.4g}"
                f" and {float(readings.max()):.4g} °C, that have nothing to do with the air: they are left out."
            ),
        ),
        rows,
    )
