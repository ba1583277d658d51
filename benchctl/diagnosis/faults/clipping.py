"""Rails: the output remains exactly at a largest value below the rated limit, at a smallest value, or at both.

If clipping occurs before the noise is added there is no exact plateau; the fit then uses the effects `saturation` and
`two_rails`.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import binary_dilation, median_filter

from benchctl.diagnosis.faults.fault import Fault, bounded_gain
from benchctl.diagnosis.faults.standing import Output, Runs
from benchctl.diagnosis.result import Estimate
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.physics.effects.effect import PhysicalEffect
from benchctl_instruments.physics.effects.saturation import Saturation
from benchctl_instruments.physics.effects.two_rails import TwoRails

_VISITS = 2
"""Minimum number of runs at the same extreme value that distinguish a rail from a held sample. One is enough if no
sample is held elsewhere, because a randomly held sample is rarely the largest of all.
"""

_ISOLATED = 5
"""Window of a running median, in rows, that removes spikes beyond the rail."""

_PRINTED = 1.02
"""Half a step, with the rounding of printed values, in half steps."""

_ALIKE = 2.0
"""Steps by which two rails may differ and still be one symmetric limit: a converter has one more negative code."""

_BESIDE, _OFTEN, _MEETINGS = 10, 10.0, 30
"""Number of neighbouring values; a rail occurs so many times as often as any of them; minimum occurrences."""

NEAR = 8
"""Rows on either side of a row at the rail that do not count: there the noise is cut on one side."""


def rail_in(output: Output, runs: Runs) -> tuple[Fault | None, BoolArray]:
    """Return the rail, if there is one, and a mask of the constant `runs` (m,) that are at it."""
    smooth: FloatArray = median_filter(np.where(output.alive, output.volts, 0.0), _ISOLATED, mode="nearest")
    values = output.volts[runs.first]
    at_rail = np.zeros(values.size, np.bool_)
    limits = []
    extremes = (float(smooth.max()), float(smooth.min()))
    fewest = _VISITS if np.any(~np.isin(values, extremes)) else 1
    for extreme in extremes:
        here = values == extreme
        if here.sum() >= fewest:
            at_rail |= here
            limits.append(extreme)
    if not limits:
        return None, at_rail
    effect, parameters = _effect_of(limits, output.step_v)
    clipped = output.alive & np.isin(output.volts, limits)
    return (
        Fault(
            effect=effect.identifier,
            parameters=parameters,
            rows=np.asarray(binary_dilation(clipped, iterations=NEAR)),
            gain=bounded_gain(float(runs.evidence[at_rail].sum())),
            says=effect.says(),
            coordinate=effect.coordinate,
        ),
        at_rail,
    )


def rail_of(volts: FloatArray) -> Fault | None:
    """Return the rail that a vibrating output (n,) reaches repeatedly for a sample or two; else None."""
    limits = limits_of(volts)
    if not limits:
        return None
    values = np.unique(volts[np.isfinite(volts)])
    effect, parameters = _effect_of(limits, float(min(values[-1] - values[-2], values[1] - values[0])))
    rows = np.isin(volts, limits)
    return Fault(
        effect=effect.identifier,
        parameters=parameters,
        rows=rows,
        gain=gain_of(rows),
        says=effect.says(),
        coordinate=effect.coordinate,
    )


def limits_of(readings: FloatArray) -> list[float]:
    """Return the largest and the smallest of readings (n,), each only if far more frequent than its neighbours."""
    values, counts = np.unique(readings[np.isfinite(readings)], return_counts=True)
    if values.size <= 2 * _BESIDE:
        return []
    return [
        float(values[end])
        for end, neighbours in ((-1, slice(-1 - _BESIDE, -1)), (0, slice(1, 1 + _BESIDE)))
        if counts[end] >= _OFTEN * counts[neighbours].max() and counts[end] >= _MEETINGS
    ]


def gain_of(rows: BoolArray) -> float:
    """Return the evidence for a limit that is reached in these rows (n,)."""
    return bounded_gain(float(rows.sum()) * math.log(_OFTEN))


def stated_limits(limits: list[float], step: float, ending: str, unit: str) -> tuple[str, dict[str, Estimate]]:
    """Return effect and parameters for limits of a quantity other than an output; parameter names end with `ending`.

    `step` is the step of the readings. A single limit keeps its sign.
    """
    half = _PRINTED * step / 2.0
    effect, names = (Saturation, ("limit",)) if len(limits) == 1 else (TwoRails, ("lower", "upper"))
    return effect.identifier, {
        f"{name}_{ending}": Estimate(value=value, low=value - half, high=value + half, unit=unit)
        for name, value in zip(names, sorted(limits), strict=True)
    }


def _effect_of(limits: list[float], step_v: float) -> tuple[PhysicalEffect, dict[str, Estimate]]:
    """Return a saturation for symmetric limits or a single one, else two rails, with its parameters."""
    half = _PRINTED * step_v / 2.0
    effect: PhysicalEffect
    if len(limits) == 1 or abs(math.fsum(limits)) <= _ALIKE * step_v:
        sizes = np.abs(limits)
        effect = Saturation(limit_v=float(sizes.mean()))
        half += _PRINTED * float(np.ptp(sizes)) / 2.0
    else:
        effect = TwoRails(lower_v=min(limits), upper_v=max(limits))
    return effect, {
        name: Estimate(value=value, low=value - half, high=value + half, unit=effect.parameters[name].unit)
        for name, value in effect.values.items()
    }
