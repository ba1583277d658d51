"""Readings of a chamber's thermometer that are none: flagged as open, beyond a counter's range, or spikes."""

from __future__ import annotations

import math

import numpy as np

from benchctl.diagnosis.faults.fault import Fault, bounded_gain
from benchctl.diagnosis.faults.wrapping import EFFECT, wraps_in
from benchctl.diagnosis.result import Estimate
from benchctl.recordings.runs import holding
from benchctl_instruments.arrays import BoolArray, FloatArray

_AROUND = 4
"""Readings on either side that a reading is held against: a spike is shorter than so many."""
_USUAL, _NORMAL_USUAL = 0.9, 1.64485
"""Share of the readings that are taken to be no spikes, and the deviations within which so many are by chance.

Of a thermometer with coarse steps most readings are just what those around them are, and their median says nothing.
"""
_BEYOND = 12.0
"""A spike is off by more than so many usual deviations, steps of the thermometer, and moves from reading to reading."""


def open_in(flags: FloatArray) -> tuple[Fault | None, BoolArray]:
    """Readings (n,) taken while the thermometer's flag said that it was open: the fault, and its rows."""
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
    """Readings [°C], (n,), that have left the range of a counter in which the first one is: the fault, and its rows.

    Those that are `known` to be spoilt are left out.
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
    """Readings [°C], (n,), that stand off from those around them on both sides: the fault, and its rows.

    Held against the median of the nearest readings, those that are `known` to be spoilt left out. Air does not leap
    there and back within a few readings; how far it strays from that median by itself is seen in most of them.
    """
    away, moves = np.zeros(read_c.size), np.zeros(read_c.size)
    for run in runs:
        rows = run.start + np.flatnonzero(~known[run])
        if rows.size > 2 * _AROUND:
            padded = np.pad(read_c[rows], _AROUND, mode="reflect")
            around = np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1)
            away[rows] = read_c[rows] - np.median(around, axis=1)
            # where the air itself turns quickly, all of its neighbours move as much
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
