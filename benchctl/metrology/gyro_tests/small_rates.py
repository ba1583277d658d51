"""Threshold and resolution: the smallest rate, and the smallest change of a rate, that show at half their size or more.

The response to a rate (or to a change from a base rate) is the change of the output over what the scale factor makes of
it. Threshold and resolution lie where it passes one half for good, in whichever direction is the worse; between two
rates on a straight line over 1/rate, as a zone that swallows the same of every rate would have it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchctl.metrology.observations import Observations, column, dots, measured, refused
from benchctl.metrology.points import Points
from benchctl.metrology.propagation import Offsets, as_read, propagated, single
from benchctl.metrology.result import Bound, Measured, Message, message
from benchctl_instruments.arrays import FloatArray, IntArray

_SMALL_DPS = 0.5
_LOWEST_BASE_DPS = 1.0
_FEWEST = 3
_HALF = 0.5
_DEG_PER_H = 3600.0


def small_rate_tests(obs: Observations) -> Iterator[Measured]:
    """Threshold about rest, resolution about a base rate."""
    yield _smallest(obs, "threshold", at_rest=True, lacking=message("needs_small_rates"))
    yield _smallest(obs, "resolution", at_rest=False, lacking=message("needs_rate_steps"))


def _smallest(obs: Observations, name: str, *, at_rest: bool, lacking: Message) -> Measured:
    for number, stretch in enumerate(obs.stretches):
        points = obs.in_stretch(number)
        base_dps = 0.0 if at_rest else _base_dps(points)
        if stretch.across or obs.reference is None or base_dps is None:
            continue
        steps = np.round(points.set_dps - base_dps, 9)
        near = np.flatnonzero((steps != 0.0) & (np.abs(steps) <= _SMALL_DPS))
        if np.unique(np.abs(steps[near])).size >= _FEWEST and (steps == 0.0).any():
            return _found(obs, name, points, np.flatnonzero(steps == 0.0), near)
    return refused(name, lacking)


def _base_dps(points: Points) -> float | None:
    """The rate that has most others within half a degree a second; None where none has."""
    bases = np.unique(points.set_dps[np.abs(points.set_dps) >= _LOWEST_BASE_DPS])
    near = [int(np.sum(np.abs(bases - one) <= _SMALL_DPS)) for one in bases]
    crowded = [one for one, count in zip(bases.tolist(), near, strict=True) if count == max(near, default=0)]
    return float(np.median(crowded)) if crowded and max(near) > _FEWEST and np.median(crowded) in bases else None


def _found(obs: Observations, name: str, points: Points, base: IntArray, near: IntArray) -> Measured:
    slope = obs.scale_v_per_dps

    def responses(offsets: Offsets) -> tuple[FloatArray, FloatArray]:
        """Sizes of the steps, growing, and the weaker response of either direction, (d, n) each."""
        rate_dps, output_v = points.moved(offsets)
        step_dps = rate_dps[:, near] - rate_dps[:, base].mean(axis=1, keepdims=True)
        response = (output_v[:, near] - output_v[:, base].mean(axis=1, keepdims=True)) / (slope * step_dps)
        sizes = np.round(np.abs(points.set_dps[near] - points.set_dps[base[0]]), 9)
        groups = [sizes == size for size in np.unique(sizes)]
        return (
            np.stack([np.abs(step_dps[:, own]).mean(axis=1) for own in groups], axis=1),
            np.stack([response[:, own].min(axis=1) for own in groups], axis=1),
        )

    quantities = obs.quantities(points)
    none = {one.name: np.zeros((1, one.root.shape[0])) for one in quantities}
    sizes, weakest = (found[0] for found in responses(none))
    gap_dps = _gap(sizes, weakest)

    def smallest(offsets: Offsets) -> FloatArray:
        return _DEG_PER_H * (_crossing(*responses(offsets)) + offsets["rates tried"][:, 0])

    every = [*quantities, single("rates tried", gap_dps / np.sqrt(12.0), "distance of the rates", uniform=True)]
    table = column("rate_step", "deg/h", _DEG_PER_H * sizes), column("response", "1", weakest)
    return measured(
        name,
        float(as_read(smallest, every)),
        propagated(smallest, every),
        points.of(np.concatenate([base, near])),
        bound=_bound(weakest),
        table=table,
        picture=dots(*table),
    )


def _bound(weakest: FloatArray) -> Bound:
    """Where even the smallest size shows, or not even the largest."""
    if weakest[-1] < _HALF:
        return "at least"
    return "at most" if bool((weakest >= _HALF).all()) else ""


def _gap(sizes: FloatArray, weakest: FloatArray) -> float:
    """Between the two rates where the response passes one half; 0 where it never is below."""
    below = np.flatnonzero(weakest < _HALF)
    if below.size == 0 or below[-1] + 1 == sizes.size:
        return 0.0
    return float(sizes[below[-1] + 1] - sizes[below[-1]])


def _crossing(sizes: FloatArray, response: FloatArray) -> FloatArray:
    """Where the response passes one half for good, (d,); the smallest size where it always has, the largest: never."""
    last = response.shape[1] - 1
    below = response < _HALF
    fails = np.where(below.any(axis=1), last - np.argmax(below[:, ::-1], axis=1), -1)
    rows, low = np.arange(response.shape[0]), np.clip(fails, 0, last - 1)
    ends, rise = 1.0 / sizes[rows, low], response[rows, low + 1] - response[rows, low]
    share = np.divide(_HALF - response[rows, low], rise, out=np.ones_like(rise), where=rise > 0.0)
    between = 1.0 / (ends + np.clip(share, 0.0, 1.0) * (1.0 / sizes[rows, low + 1] - ends))
    return np.where(fails < 0, sizes[:, 0], np.where(fails == last, sizes[:, -1], between))
