"""The grid of a channel's values: the converter's step, determined from the numbers themselves.

Files contain decimals, so a value differs from its code by up to half a unit of the last decimal. An offset of the
codes (a converter that rounds to the middle of its steps, a subtracted zero) has no influence: differences are tested.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import rel_entr

from benchctl.diagnosis.faults.fault import CHANCE
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray

_ON_GRID = 0.99
"""Minimum share of the rows on a grid; the others may be outliers, or come from another converter."""

_MOST_BITS = 12
_DECIMALS = range(2, 10)
_EXACT = 1e-3
"""Tolerance, in units of the last decimal, for a value to be an integer number of them."""

_SINGLE = 5e-7
"""Error of a difference of two values of a few volts in single precision."""

_VISIBLE = 4.0
"""Minimum ratio of a step to the rounding of printed values."""

_REACHES = (5, 20, 80, 320, 1280, 5120, 20_480)
"""Distances in codes from the most frequent one within which the step is fitted, in turn."""

_NEAR_POWER = 0.05
"""Tolerance of log2 of the ratio of a step to the stated one from an integer: converters are calibrated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """A grid: `step_v` between neighbouring codes or printed values, 0 if none is visible.

    `bits_lost` is the number of the converter's bits that never change, 0 if all do. `evidence` is the logarithm of the
    ratio by which these values are less likely on the converter's own grid.
    """

    step_v: float
    bits_lost: int = 0
    evidence: float = 0.0


def grid_of(volts: FloatArray, adc_step_v: float) -> Grid:
    """Return the grid of a channel's values, shape (n,), without rows at a rail.

    `adc_step_v` is the converter's step as stated in the file, 0 if it is not stated.
    """
    if volts.size == 0:
        return Grid(step_v=0.0)
    values, counts = np.unique(volts, return_counts=True)
    unit = _unit(values)
    distances = values - float(values[np.argmax(counts)])
    if adc_step_v > 0.0:
        grids = [_with_lost(bits, distances, counts, adc_step_v, unit) for bits in range(_MOST_BITS + 1)]
        # by evidence, since enough rows may stand on a finer grid, too, if some are off the true one
        likeliest, suffices = max(grids, key=lambda one: one[0].evidence)
        if suffices and likeliest.evidence > math.log((_MOST_BITS + 1) / CHANCE):
            return likeliest
        if grids[0][1]:
            return grids[0][0]
    step = _derived(values, distances, counts, unit)
    if step == 0.0:
        return Grid(step_v=unit)
    power = math.log2(step / adc_step_v) if adc_step_v > 0.0 else 0.0
    bits = round(power)
    evidence = _evidence(_on_grid(distances, step, 2.0 * _printed(unit)), 2.0 ** -max(bits, 0))
    if bits < 1 or abs(power - bits) > _NEAR_POWER or evidence < math.log(1.0 / CHANCE):
        return Grid(step_v=step)
    return Grid(step_v=step, bits_lost=bits, evidence=evidence)


def _unit(values: FloatArray) -> float:
    """Return the unit of the last decimal that the values were printed with; 0 if they were not printed."""
    for decimals in _DECIMALS:
        scaled = values * 10.0**decimals
        if np.all(np.abs(scaled - np.rint(scaled)) < _EXACT):
            return float(10.0**-decimals)
    return 0.0


def _slack(step: float, unit: float) -> float:
    """Return how much printing can change the difference of two values that are an integer number of steps apart."""
    units = step / unit if unit > 0.0 else 0.0
    return 2.0 * _EXACT * unit if abs(units - round(units)) < _EXACT and units > 0.5 else _printed(unit)


def _printed(unit: float) -> float:
    """Return how much printing can change the difference of any two values."""
    return 1.02 * unit if unit > 0.0 else _SINGLE


def _with_lost(bits: int, distances: FloatArray, counts: IntArray, adc_step_v: float, unit: float) -> tuple[Grid, bool]:
    """Return the grid of a converter that lost so many bits, and whether enough rows stand on it."""
    step = adc_step_v * 2.0**bits
    slack = _slack(step, unit)
    if step < _VISIBLE * slack:
        return Grid(step_v=step, bits_lost=bits), False
    on_grid = _on_grid(distances, step, slack)
    evidence = _evidence(on_grid, max(2.0**-bits, 2.0 * slack / step))
    return Grid(step_v=step, bits_lost=bits, evidence=evidence), _suffices(on_grid, counts)


def _on_grid(distances: FloatArray, step: float, slack: float) -> BoolArray:
    codes = distances / step
    return np.asarray(np.abs(codes - np.rint(codes)) * step <= slack)


def _suffices(on_grid: BoolArray, counts: IntArray) -> bool:
    return float(counts[on_grid].sum()) >= _ON_GRID * float(counts.sum())


def _evidence(on_grid: BoolArray, chance: float) -> float:
    """Return the log likelihood ratio of different values, of which some stand on a grid, each by chance with `chance`.

    The first one stands on it by definition.
    """
    others = on_grid.size - 1
    share = (float(np.count_nonzero(on_grid)) - 1.0) / max(others, 1)
    if share <= chance:
        return 0.0
    return others * float(rel_entr(share, chance) + rel_entr(1.0 - share, 1.0 - chance))


def _derived(values: FloatArray, distances: FloatArray, counts: IntArray, unit: float) -> float:
    """Return the step estimated from the values alone, which are a few steps apart; 0 if they are on no grid."""
    slack = _printed(unit)
    gaps = np.diff(values)
    gaps = gaps[gaps > 2.0 * slack]
    if gaps.size < 2:
        return 0.0
    step = float(np.quantile(gaps, 0.05))
    for reach in (*_REACHES, np.inf):
        # near values determine the step well enough to count the codes of more distant ones
        near = distances[np.abs(distances) < reach * step]
        codes = np.rint(near / step)
        if codes.any():
            step = float(near @ codes / (codes @ codes))
    return step if step >= _VISIBLE * slack and _suffices(_on_grid(distances, step, 2.0 * slack), counts) else 0.0
