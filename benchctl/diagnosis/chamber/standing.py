"""A thermometer's converter at its rail: the reading stands at one value while the air goes on.

Air stands still too, but it settles: what heats it has its own time constant, and so it slows down before it stands.
Where it comes to a limit at full speed and stands there at once, or leaves it so, while its drive hardly changes, it is
the reading that has stopped.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import binary_dilation, median_filter

from benchctl.diagnosis.faults.clipping import NEAR, gain_of, limits_of, stated_limits
from benchctl.diagnosis.faults.fault import Fault
from benchctl.recordings.runs import holding
from benchctl.signals.normal import white_noise_of
from benchctl_instruments.arrays import BoolArray, FloatArray

_ISOLATED = 5
"""Readings of a running median by which a reading stands, whatever its noise."""

_WAY_STEPS, _WAY_DEVIATIONS = 10.0, 20.0
"""Steps of the thermometer, and deviations of its noise, in each of the two ways whose times are compared."""

_SLOWER = 2.0
"""The last way takes no more than so many times the one before; of what settles it takes 3.5 times as long, or more."""

_HARDLY = 0.05
"""Share of its span by which the drive may change meanwhile."""


def rail_in(
    read_c: FloatArray, known: BoolArray, drive: FloatArray, step_c: float, runs: tuple[slice, ...], *, asked: bool
) -> tuple[Fault | None, BoolArray]:
    """Readings [°C], (n,), at a rail of the thermometer's converter: the fault, and its rows.

    Those that are `known` to be spoilt are left out. `drive` is a power, or the temperature [°C] that is `asked` for: a
    chamber that stands where it was asked to is at no rail.
    """
    limits = [
        limit
        for limit, way in _ends(read_c[~known])
        if _stops_at(limit, way, read_c, known, drive, step_c, runs, asked=asked)
    ]
    at_rail = np.isin(read_c, limits) & ~known
    if not limits:
        return None, at_rail
    effect, parameters = stated_limits(limits, step_c, "c", "degC")
    rows = np.asarray(binary_dilation(at_rail, iterations=NEAR))
    stated = " and ".join(f"{limit:.4g} °C" for limit in limits)
    return (
        Fault(
            effect=effect,
            parameters=parameters,
            rows=rows,
            gain=gain_of(at_rail),
            says=(
                f"The thermometer stands at {stated} in {int(at_rail.sum())} of {read_c.size} readings although the air"
                " goes on: its converter is at the rail. These are left out."
            ),
            coordinate="chamber_temp",
        ),
        rows,
    )


def _ends(readings: FloatArray) -> Iterator[tuple[float, float]]:
    """Where readings (n,) stand at an end of their range, and which way it lies."""
    for limit in limits_of(readings):
        yield limit, 1.0 if limit == readings.max() else -1.0


def _stops_at(
    limit: float,
    way: float,
    read_c: FloatArray,
    known: BoolArray,
    drive: FloatArray,
    step_c: float,
    runs: tuple[slice, ...],
    *,
    asked: bool,
) -> bool:
    """Whether the reading stops at a limit, wherever its coming or going can be judged, and that it can somewhere."""
    seen: list[bool] = []
    hardly = _HARDLY * float(np.ptp(drive))
    for run in runs:
        rows = run.start + np.flatnonzero(~known[run])
        if rows.size < _ISOLATED:
            continue
        far = way * (limit - median_filter(read_c[rows], _ISOLATED, mode="nearest"))
        distance = max(_WAY_STEPS * step_c, _WAY_DEVIATIONS * white_noise_of(read_c[rows]))
        driven = drive[rows]
        for order in (slice(None), slice(None, None, -1)):
            for first, last, stopped in _comings(far[order], distance):
                meanwhile = driven[order][first:last]
                on = not asked or float((way * (meanwhile - limit)).min()) > distance
                if on and float(np.ptp(meanwhile)) <= hardly:
                    seen.append(stopped)
    return bool(seen) and all(seen)


def _comings(far: FloatArray, distance: float) -> Iterator[tuple[int, int, bool]]:
    """Each coming to a limit that is `far` (n,): where it begins and ends, and whether the reading stopped at once.

    It is judged over the last `distance` and the one before it, and until it has stood as long as the last one took.
    """
    for run in holding(far <= 0.0):
        begin, end = run.start, run.stop
        before = np.flatnonzero(far[:begin] >= distance)
        earlier = np.flatnonzero(far[: before[-1]] >= 2.0 * distance) if before.size else before
        if earlier.size == 0:
            continue
        last, one_before = begin - int(before[-1]), int(before[-1] - earlier[-1])
        if end - begin >= last:
            yield int(earlier[-1]), begin + last, last <= _SLOWER * one_before
