"""A thermometer's converter at its rail: the reading is constant while the air temperature continues to change.

The air also becomes constant, but it settles: the time constant of its heating makes it slow down first. If the reading
reaches a limit at full speed and stops at once, or leaves it at full speed, while the drive hardly changes, it is the
reading that has stopped.
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
"""Window of a running median, in readings, for testing whether a reading is at a limit in spite of noise."""

_WAY_STEPS, _WAY_DEVIATIONS = 10.0, 20.0
"""Length of the two intervals compared before a limit, in steps of the thermometer and deviations of its noise."""

_SLOWER = 2.0
"""Maximum time ratio of the last interval to the one before; for settling air the ratio is 3.5 or more."""

_HARDLY = 0.05
"""Maximum change of the drive during the approach, as a share of its span."""


def rail_in(
    read_c: FloatArray, known: BoolArray, drive: FloatArray, step_c: float, runs: tuple[slice, ...], *, asked: bool
) -> tuple[Fault | None, BoolArray]:
    """Return the fault and the rows of readings [°C], (n,), at a rail of the thermometer's converter.

    Readings `known` to be spoilt are ignored. `drive` is a power or, if `asked`, the requested temperature [°C]: a
    chamber at its requested temperature is at no rail.
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
                f"The thermometer reads {stated} in {int(at_rail.sum())} of {read_c.size} readings although the air"
                " goes on: its converter is at the rail. These are left out."
            ),
            coordinate="chamber_temp",
        ),
        rows,
    )


def _ends(readings: FloatArray) -> Iterator[tuple[float, float]]:
    """Yield each end of the range at which readings (n,) accumulate, with its direction."""
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
    """Return whether the reading stops at a limit in every approach or departure that can be judged (at least one)."""
    stops: list[bool] = []
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
                    stops.append(stopped)
    return bool(stops) and all(stops)


def _comings(far: FloatArray, distance: float) -> Iterator[tuple[int, int, bool]]:
    """Yield each approach to a limit that is `far` (n,) away: its first row, its end, and whether it stopped abruptly.

    The time for the last `distance` is compared with that for the one before; the end is after the reading has been at
    the limit for as long as the last interval took.
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
