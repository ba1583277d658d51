"""The grid that the values of a channel stand on: the converter's step as it shows in the numbers themselves.

Files hold decimals, so a value is off its code by up to half a unit of the last one. An offset of the codes (a
converter that rounds to the middle of its steps, a subtracted zero) does not matter: differences of values are judged.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from benchctl.diagnosis.faults.fault import CHANCE
from benchctl_instruments.arrays import FloatArray, IntArray

_ON_GRID = 0.999
"""Share of the rows that must stand on a grid; the rest may be of another converter's making."""

_MOST_BITS = 12
_DECIMALS = range(2, 10)
_EXACT = 1e-3
"""In units of the last decimal: how well a value is a whole number of them."""

_SINGLE = 5e-7
"""Error of a difference of two values of some volts in single precision."""

_VISIBLE = 4.0
"""A step must be so many times as large as what printing can move a value."""

_REACHES = (5, 20, 80, 320, 1280, 5120, 20_480)
"""Codes from the most frequent one within which the step is fitted, one after the other."""

_NEAR_POWER = 0.05
"""How far log2 of a step over the stated one may be from a whole number: converters are calibrated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """A grid: `step_v` between neighbouring codes or printed values, 0 where none shows.

    `bits_lost` is how many of the stated step's bits never move, 0 where all do.
    `evidence` is the log of how much less likely these values are on the converter's own grid.
    """

    step_v: float
    bits_lost: int = 0
    evidence: float = 0.0


def grid_of(volts: FloatArray, adc_step_v: float) -> Grid:
    """The grid of a channel's values, shape (n,), rows at a rail left out.

    `adc_step_v` is the converter's own step as the file states it, 0 where it does not.
    """
    if volts.size == 0:
        return Grid(step_v=0.0)
    values, counts = np.unique(volts, return_counts=True)
    unit = _unit(values)
    distances = values - float(values[np.argmax(counts)])
    for bits in range(_MOST_BITS, -1, -1) if adc_step_v > 0.0 else ():
        step = adc_step_v * 2.0**bits
        slack = _slack(step, unit)
        if step < _VISIBLE * slack or not _stands_on(distances, counts, step, slack):
            continue
        chance = max(2.0**-bits, 2.0 * slack / step)
        evidence = -(values.size - 1) * math.log(chance)
        if bits == 0 or evidence > math.log((_MOST_BITS + 1) / CHANCE):
            return Grid(step_v=step, bits_lost=bits, evidence=evidence)
    step = _derived(values, distances, counts, unit)
    if step == 0.0:
        return Grid(step_v=unit)
    power = math.log2(step / adc_step_v) if adc_step_v > 0.0 else 0.0
    bits = round(power)
    evidence = (values.size - 1) * max(bits, 0) * math.log(2.0)
    if bits < 1 or abs(power - bits) > _NEAR_POWER or evidence < math.log(1.0 / CHANCE):
        return Grid(step_v=step)
    return Grid(step_v=step, bits_lost=bits, evidence=evidence)


def _unit(values: FloatArray) -> float:
    """The unit of the last decimal that the values were printed with; 0 where they were not."""
    for decimals in _DECIMALS:
        scaled = values * 10.0**decimals
        if np.all(np.abs(scaled - np.rint(scaled)) < _EXACT):
            return float(10.0**-decimals)
    return 0.0


def _slack(step: float, unit: float) -> float:
    """By how much printing can move the difference of two values that are whole steps apart."""
    if unit == 0.0:
        return _SINGLE
    units = step / unit
    return (2.0 * _EXACT if abs(units - round(units)) < _EXACT and units > 0.5 else 1.02) * unit


def _stands_on(distances: FloatArray, counts: IntArray, step: float, slack: float) -> bool:
    codes = distances / step
    on_grid = np.abs(codes - np.rint(codes)) * step <= slack
    return float(counts[on_grid].sum()) >= _ON_GRID * float(counts.sum())


def _derived(values: FloatArray, distances: FloatArray, counts: IntArray, unit: float) -> float:
    """The step from the values alone: neighbouring ones are a few whole steps apart; 0 where they are on no grid."""
    slack = 1.02 * unit if unit > 0.0 else _SINGLE
    gaps = np.diff(values)
    gaps = gaps[gaps > 2.0 * slack]
    if gaps.size < 2:
        return 0.0
    step = float(np.quantile(gaps, 0.05))
    for reach in (*_REACHES, np.inf):
        # near values tell the step well enough to count the codes of farther ones
        near = distances[np.abs(distances) < reach * step]
        codes = np.rint(near / step)
        if codes.any():
            step = float(near @ codes / (codes @ codes))
    return step if step >= _VISIBLE * slack and _stands_on(distances, counts, step, 2.0 * slack) else 0.0
