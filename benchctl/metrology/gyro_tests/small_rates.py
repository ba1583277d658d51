"""Threshold, resolution and dead zone: the smallest rate, or change of rate, with at least half the expected response.

The response to a rate (or to a change from a base rate) is the change of the output divided by that expected from the
scale factor. Threshold and resolution are the size above which it stays over one half, in the worse direction; between
two rates it is interpolated linearly over 1/rate, as for a zone that takes the same amount off every rate.

Dead zone: the rates about zero over which the output changes by less than half of what the scale factor predicts, in a
slow swing through zero. Samples are grouped in narrow bins of rate, and the slope between neighbouring bins is compared
with the scale factor.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchctl.metrology.drift import white_variance
from benchctl.metrology.names import UNITS
from benchctl.metrology.observations import Observations, celsius_of, column, dots, measured, refused
from benchctl.metrology.points import Points
from benchctl.metrology.propagation import Offsets, Quantity, as_read, propagated, single, standards
from benchctl.metrology.result import Bound, Measured, Message, message
from benchctl.metrology.swings import Swing, fitted
from benchctl.recordings.model import StepInfo
from benchctl.signals.segments import CHANNELS
from benchctl_instruments.arrays import FloatArray, IntArray

_SMALL_DPS = 0.5
_LOWEST_BASE_DPS = 1.0
_FEWEST = 3
_HALF = 0.5
_DEG_PER_H = 3600.0


def small_rate_tests(obs: Observations) -> Iterator[Measured]:
    """Yield the threshold about rest and the resolution about a base rate."""
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
    """Return the rate with the most others within half a degree per second; None if no rate has enough."""
    bases = np.unique(points.set_dps[np.abs(points.set_dps) >= _LOWEST_BASE_DPS])
    near = [int(np.sum(np.abs(bases - one) <= _SMALL_DPS)) for one in bases]
    crowded = [one for one, count in zip(bases.tolist(), near, strict=True) if count == max(near, default=0)]
    return float(np.median(crowded)) if crowded and max(near) > _FEWEST and np.median(crowded) in bases else None


def _found(obs: Observations, name: str, points: Points, base: IntArray, near: IntArray) -> Measured:
    slope = obs.scale_v_per_dps

    def responses(offsets: Offsets) -> tuple[FloatArray, FloatArray]:
        """Return the sizes of the steps, increasing, and the weaker response of both directions, (d, n) each."""
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
        picture=dots(*table, standard=standards(lambda offsets: responses(offsets)[1], quantities), limited="x"),
    )


def _bound(weakest: FloatArray) -> Bound:
    """Return whether the result is a bound: even the smallest size shows, or not even the largest."""
    if weakest[-1] < _HALF:
        return "at least"
    return "at most" if bool((weakest >= _HALF).all()) else ""


def _gap(sizes: FloatArray, weakest: FloatArray) -> float:
    """Return the distance of the two rates between which the response passes one half; 0 if it is never below."""
    below = np.flatnonzero(weakest < _HALF)
    if below.size == 0 or below[-1] + 1 == sizes.size:
        return 0.0
    return float(sizes[below[-1] + 1] - sizes[below[-1]])


def _crossing(sizes: FloatArray, response: FloatArray) -> FloatArray:
    """Return where the response passes one half for the last time, (d,); else the smallest or largest size."""
    last = response.shape[1] - 1
    below = response < _HALF
    fails = np.where(below.any(axis=1), last - np.argmax(below[:, ::-1], axis=1), -1)
    rows, low = np.arange(response.shape[0]), np.clip(fails, 0, last - 1)
    ends, rise = 1.0 / sizes[rows, low], response[rows, low + 1] - response[rows, low]
    share = np.divide(_HALF - response[rows, low], rise, out=np.ones_like(rise), where=rise > 0.0)
    between = 1.0 / (ends + np.clip(share, 0.0, 1.0) * (1.0 / sizes[rows, low + 1] - ends))
    return np.where(fails < 0, sizes[:, 0], np.where(fails == last, sizes[:, -1], between))


_DEAD_ZONE = "dead_zone"
_WIDEST_DPS, _FASTEST_HZ = 2.0, 0.1
_BINS = 25
_USED = 0.95
"""Share of the amplitude that is used: near its ends a sine gives no further information."""


def dead_zone_tests(obs: Observations) -> Iterator[Measured]:
    """Yield the dead zone."""
    info = _slow_swing(obs)
    if info is None or info.frequency_hz is None:
        yield refused(_DEAD_ZONE, message("needs_slow_swing"))
        return
    swing = fitted(obs.recording.step(info.index, CHANNELS), info.frequency_hz, obs.recording.meta)
    edges = _USED * (0.0 if swing is None else abs(swing.rate_phasor)) * np.linspace(-1.0, 1.0, _BINS + 1)
    if swing is None or not np.histogram(swing.rate_dps, edges)[0].all():
        yield refused(_DEAD_ZONE, message("needs_slow_swing"))
        return
    output_v, standard_v = _binned(swing, edges)
    middle, width_dps = 0.5 * (edges[1:] + edges[:-1]), float(edges[1] - edges[0])
    slope = obs.scale_v_per_dps

    def slopes(offsets: Offsets) -> FloatArray:
        return np.asarray(np.diff(output_v + offsets["scatter"], axis=1) / (slope * width_dps))

    def zone(offsets: Offsets) -> FloatArray:
        return _DEG_PER_H * (width_dps * _longest_run(slopes(offsets) < _HALF) + offsets["bins"][:, 0])

    quantities: list[Quantity] = [
        Quantity(name="scatter", root=np.diag(standard_v), kind="A", note="scatter of the samples in a bin"),
        single("bins", width_dps / np.sqrt(6.0), "width of the bins, at both ends"),
    ]
    response = as_read(slopes, quantities)
    seen_one = bool((response < _HALF).any())
    between = 0.5 * (middle[1:] + middle[:-1])
    table = column("rate", "deg/h", _DEG_PER_H * between), column("response", "1", response)
    yield Measured(
        name=_DEAD_ZONE,
        unit=UNITS[_DEAD_ZONE],
        value=float(as_read(zone, quantities)) if seen_one else _DEG_PER_H * width_dps,
        uncertainty=propagated(zone, quantities),
        bound="" if seen_one else "at most",
        temperature_c=celsius_of(info.chamber_setpoint_c),
        steps=(info.index,),
        table=table,
        picture=dots(*table, standard=standards(slopes, quantities)),
    )


def _slow_swing(obs: Observations) -> StepInfo | None:
    if obs.reference is None:
        return None
    for info in obs.recording.infos:
        slow = info.frequency_hz is not None and info.frequency_hz <= _FASTEST_HZ
        small = (info.amplitude_dps or np.inf) <= _WIDEST_DPS
        if info.kind == "sine" and info.whole and slow and small and not info.mounting:
            return info
    return None


def _binned(swing: Swing, edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean output in each bin, moved to its middle, and its standard uncertainty; (bins,) each."""
    middle = 0.5 * (edges[1:] + edges[:-1])
    place = np.digitize(swing.rate_dps, edges) - 1
    inside = (place >= 0) & (place < middle.size)
    place, rate_dps, output_v = place[inside], swing.rate_dps[inside], swing.output_v[inside]
    slope = float(np.polyfit(rate_dps, output_v, 1)[0])
    count = np.bincount(place, minlength=middle.size)
    off_dps = np.bincount(place, rate_dps, middle.size) / count - middle
    # inside a zone the output does not follow the rate; there the samples are spread evenly, and nothing is moved
    means = np.bincount(place, output_v, middle.size) / count - slope * off_dps
    white_v = float(np.sqrt(white_variance(swing.output_v)))
    return means, white_v / np.sqrt(count)


def _longest_run(flags: np.ndarray) -> FloatArray:
    """Return the length of the longest run of true flags in each row of (d, n)."""
    longest, current = np.zeros(flags.shape[0]), np.zeros(flags.shape[0])
    for column_of in flags.T:
        current = np.where(column_of, current + 1.0, 0.0)
        longest = np.maximum(longest, current)
    return longest
