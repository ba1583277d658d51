"""Rails: the output stands exactly at one largest value, below the rated limit.

Where the clipping comes before the noise there is no exact plateau; that is for the effect `saturation` in the fit.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation, median_filter

from benchctl.diagnosis.faults.fault import Fault, bounded_gain
from benchctl.diagnosis.faults.standing import Output, Runs
from benchctl.diagnosis.result import Estimate
from instruments.physics.effects.saturation import Saturation

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

_VISITS = 2
"""Runs at the same extreme value that make it a rail rather than a held sample; one will do where nothing is held
elsewhere, as a sample that happens to be held is hardly ever the largest of all.
"""

_ISOLATED = 5
"""Rows of a running median that takes away spikes beyond the rail."""

_PRINTED = 1.02
"""Half a step, and what printing adds to it."""

_NEAR = 8
"""Rows on either side of one at the rail that do not count: noise is cut there on one side only."""


def rail_in(output: Output, runs: Runs) -> tuple[Fault | None, BoolArray]:
    """The rail, if there is one, and which of the standing `runs` (m,) stand at it."""
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
    sizes = np.abs(limits)
    value, half = float(sizes.mean()), _PRINTED * float(np.ptp(sizes) + output.step_v) / 2.0
    effect = Saturation(limit_v=value)
    clipped = output.alive & np.isin(output.volts, limits)
    return (
        Fault(
            effect=effect.identifier,
            parameters={
                "limit_v": Estimate(
                    value=value, low=value - half, high=value + half, unit=effect.parameters["limit_v"].unit
                )
            },
            rows=np.asarray(binary_dilation(clipped, iterations=_NEAR)),
            gain=bounded_gain(float(runs.evidence[at_rail].sum())),
            says=effect.says(),
        ),
        at_rail,
    )
