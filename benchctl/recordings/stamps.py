"""Time stamps of foreign rows: check whether they are the uniform clock that they should be, and repair them.

A logger that samples on a uniform clock still prints rounded stamps, writes a row twice, or loses one. Such stamps can
be repaired: each row gets its place on the clock that all stamps together define, and places without a row are gaps. If
a logger pauses and starts again between two places of its clock, a new stretch begins there with a separate phase. A
row is never moved relative to the other columns of the same row, so a delay between two columns is preserved. Stamps
with real scatter are refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchctl.limits import HIGHEST_RATE_HZ, LONGEST_TIME_S
from benchctl.recordings.runs import TOLERANCE
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray

LONGEST_FILL = 2
"""Number of consecutive missing samples that a fill may bridge; longer gaps split the recording."""

DOUBT = 0.35
"""A stamp this far (in periods) from an integer number of periods after the previous one has no certain place."""

_MOST_RESTARTS = 0.02
"""The share of the rows that may have no certain place; with more, the rows follow no clock."""

_SURE_UP_TO = 100.0
"""Periods; after a longer pause the place need not be certain, because the recording is split there anyway."""

_MOST_PLACES = 2.0**52
"""Maximum number of periods from the first stamp to the last: integers are exact up to here."""

_DRIFT_BLOCK = 500
"""Samples over which rounding is averaged, to show the drift of the clock."""


class StampError(Exception):
    """Stamps that cannot be used; `row` counts samples from 0."""

    def __init__(self, row: int, message: str) -> None:
        self.row = row
        self.message = message
        super().__init__(f"sample {row}: {message}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """`missing` samples after the source's row `after_row` (from 0), whose stamp is `stamp_s`."""

    after_row: int
    missing: int
    stamp_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """What was found in the stamps.

    `repeated_rows` (from 0) repeat the row before, stamp and values. `scatter_rms_s` is the residual of the stamps from
    the uniform clock without its slow drift, whose range is `drift_s`; rounding alone gives `rounding_rms_s`, which is
    resolution/√12. `restarts` counts the gaps after which the clock restarts between two of its places.
    """

    rows: int
    resolution_s: float
    period_s: float
    repeated_rows: tuple[int, ...]
    gaps: tuple[Gap, ...]
    restarts: int
    scatter_rms_s: float
    rounding_rms_s: float
    drift_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeBase:
    """The samples on their clock: `time_s`, shape (n,), from 0, and the source's row of each, -1 if it is filled in.

    `starts` are the samples at which a stretch without gaps begins; the first is 0. `rate_hz` is None if the stamps are
    not uniform.
    """

    time_s: FloatArray
    rows: IntArray
    starts: tuple[int, ...]
    rate_hz: float | None
    survey: Survey | None = None

    @property
    def filled(self) -> BoolArray:
        """Which samples were not measured, shape (n,)."""
        return np.asarray(self.rows < 0)

    def place(self, values: FloatArray) -> FloatArray:
        """Return the source's column, shape (rows,), on this clock, shape (n,); holes are filled in linearly."""
        filled = self.filled
        placed = values[self.rows]
        if filled.any():
            placed[filled] = np.interp(self.time_s[filled], self.time_s[~filled], placed[~filled])
        return placed


def printed_resolution(stamps_s: FloatArray) -> float:
    """Return the power of ten (s) to which stamps are printed, at least 1 µs; 0 if they have more digits."""
    size = float(np.max(np.abs(stamps_s), initial=1.0))
    for decimals in range(7):
        scaled = stamps_s * 10.0**decimals
        if float(np.max(np.abs(scaled - np.rint(scaled)), initial=0.0)) <= 4e-16 * size * 10.0**decimals + 1e-9:
            return float(10.0**-decimals)
    return 0.0


def require_increase(stamps_s: FloatArray) -> None:
    """Check that every stamp is later than the one before, and none is beyond `LONGEST_TIME_S`; shape (n,), n ≥ 1.

    Raises
    ------
    StampError
        At the first stamp that is not.
    """
    _refuse_far(stamps_s)
    late = np.flatnonzero(np.diff(stamps_s) <= 0)
    if late.size:
        row = int(late[0]) + 1
        now, before = stamps_s[row], stamps_s[row - 1]
        problem = "repeats that of the row before" if now == before else f"goes back from {before:.9g} s"
        raise StampError(row, f"the stamp {now:.9g} s {problem}: stamps must increase")


def _refuse_far(stamps_s: FloatArray) -> None:
    far = np.flatnonzero(np.abs(stamps_s) > LONGEST_TIME_S)
    if far.size:
        row = int(far[0])
        raise StampError(row, f"the stamp {stamps_s[row]:.9g} s is further than {LONGEST_TIME_S:g} s from its zero")


def require_uniform(stamps_s: FloatArray, rate_hz: float, resolution_s: float) -> None:
    """Check that the stamps are those of a uniform clock, printed to `resolution_s`; shape (n,), n ≥ 1.

    Raises
    ------
    StampError
        At the first stamp that goes back, follows a gap, or is off the clock by more than the printing explains.
    """
    require_increase(stamps_s)
    period = 1.0 / rate_hz
    steps = np.diff(stamps_s)
    gaps = np.flatnonzero(steps > (1.0 + TOLERANCE) * period)
    ideal = stamps_s[0] + np.arange(stamps_s.size) * period
    off = np.abs(stamps_s - ideal)
    allowed = max(1.01 * resolution_s, 1e-3 * period)
    off_clock = np.flatnonzero(off > allowed)
    first_gap = int(gaps[0]) + 1 if gaps.size else stamps_s.size
    first_off = int(off_clock[0]) if off_clock.size else stamps_s.size
    if first_gap < stamps_s.size and first_gap <= first_off:
        missing = max(1, round(steps[first_gap - 1] / period) - 1)
        raise StampError(
            first_gap,
            f"a gap: {steps[first_gap - 1]:.6g} s after the row before, where {rate_hz:.9g} Hz gives {period:.6g} s "
            f"({missing} {'sample' if missing == 1 else 'samples'} missing)",
        )
    if first_off < stamps_s.size:
        raise StampError(
            first_off,
            f"the stamp {stamps_s[first_off]:.9g} s is not uniform at {rate_hz:.9g} Hz: "
            f"expected {ideal[first_off]:.9g} s",
        )


def as_stamped(stamps_s: FloatArray, rate_hz: float | None) -> TimeBase:
    """Return the rows at their own stamps, counted from the first."""
    rows = np.arange(stamps_s.size, dtype=np.int64)
    return TimeBase(time_s=stamps_s - stamps_s[0], rows=rows, starts=(0,), rate_hz=rate_hz)


def repair(stamps_s: FloatArray, repeats: BoolArray, *, fill: bool) -> TimeBase:
    """Return each row at its place on the uniform clock that all stamps together define.

    Parameters
    ----------
    stamps_s
        Shape (rows,), rows ≥ 3.
    repeats
        Shape (rows,): the row repeats the values of the row before. It is dropped if its stamp is the same, too.
    fill
        Fill gaps of up to `LONGEST_FILL` samples, marked as such; otherwise, and for longer ones, a new stretch begins.

    A pause that is not an integer number of periods also begins a new stretch; its stamps give its phase.

    Raises
    ------
    StampError
        A stamp goes back, two different rows have the same stamp, or more than one row in fifty has no certain place.
    """
    _refuse_far(stamps_s)
    same = np.r_[False, stamps_s[1:] == stamps_s[:-1]]
    dropped = same & repeats
    if (odd := np.flatnonzero(same & ~repeats)).size:
        raise StampError(int(odd[0]), "two rows with one stamp and different values: cannot tell which stamp is wrong")
    kept = np.flatnonzero(~dropped)
    clock = stamps_s[kept]
    try:
        require_increase(clock)
    except StampError as err:
        raise StampError(int(kept[err.row]), err.message) from None
    if clock.size < 3:
        raise StampError(0, "fewer than three different stamps: they define no clock")
    places, period, restarts = _places(clock, kept)
    stretch = np.zeros(clock.size, dtype=np.int64)
    stretch[restarts] = 1
    stretch = np.cumsum(stretch)
    off = clock - clock[0] - places * period
    phase = np.bincount(stretch, off) / np.bincount(stretch)
    phase_s = (phase - phase[0])[stretch]
    survey = _survey(stamps_s, np.flatnonzero(dropped), kept, places, period, phase_s, restarts.size)
    return _lay_out(kept, places, period, phase_s, survey, fill=fill)


def _places(clock: FloatArray, kept: IntArray) -> tuple[IntArray, float, IntArray]:
    """Return the place of each stamp on the clock, in periods from the first; the period; the rows where it restarts.

    The period is a least-squares fit over all stretches between restarts, each with a separate phase.
    """
    steps = np.diff(clock)
    period = float(np.median(steps))
    if period < 1.0 / HIGHEST_RATE_HZ or (clock[-1] - clock[0]) / period > _MOST_PLACES:
        raise StampError(
            int(kept[-1]), f"{clock[-1] - clock[0]:.6g} s after the first, with {period:.6g} s from row to row"
        )
    restarts = np.empty(0, dtype=np.int64)
    for _ in range(2):
        places = np.r_[0, np.cumsum(np.maximum(1.0, np.rint(steps / period)))]
        stretch = np.searchsorted(restarts, np.arange(clock.size), side="right")
        members = np.bincount(stretch)
        centred = places - (np.bincount(stretch, places) / members)[stretch]
        period = float(np.dot(centred, clock) / np.dot(centred, centred))
        periods = steps / period
        doubtful = (np.abs(periods - np.rint(periods)) > DOUBT) & (periods < _SURE_UP_TO)
        restarts = np.flatnonzero(doubtful) + 1
    if restarts.size > max(1.0, _MOST_RESTARTS * clock.size):
        row = int(restarts[0])
        raise StampError(
            int(kept[row]),
            f"{steps[row - 1] * 1e3:.6g} ms after the row before, {periods[row - 1]:.2f} periods of "
            f"{period * 1e3:.6g} ms, and {restarts.size} rows of {clock.size} have no certain place on a uniform clock",
        )
    return places.astype(np.int64), period, restarts


def _survey(
    stamps_s: FloatArray,
    dropped: IntArray,
    kept: IntArray,
    places: IntArray,
    period: float,
    phase_s: FloatArray,
    restarts: int,
) -> Survey:
    clock = stamps_s[kept]
    off = clock - places * period - phase_s
    off = off - off.mean()
    blocks = max(1, off.size // _DRIFT_BLOCK)
    wander = np.array([part.mean() for part in np.array_split(off, blocks)])
    centres = np.array([part.mean() for part in np.array_split(places.astype(np.float64), blocks)])
    residual = off - np.interp(places, centres, wander)
    resolution = printed_resolution(stamps_s)
    jumps = np.flatnonzero(np.diff(places) > 1)
    return Survey(
        rows=int(stamps_s.size),
        resolution_s=resolution,
        period_s=period,
        repeated_rows=tuple(int(row) for row in dropped),
        gaps=tuple(
            Gap(after_row=int(kept[k]), missing=int(places[k + 1] - places[k] - 1), stamp_s=float(clock[k]))
            for k in jumps
        ),
        restarts=restarts,
        scatter_rms_s=float(residual.std()),
        rounding_rms_s=resolution / 12**0.5,
        drift_s=float(np.ptp(wander)),
    )


def _lay_out(
    kept: IntArray, places: IntArray, period: float, phase_s: FloatArray, survey: Survey, *, fill: bool
) -> TimeBase:
    jumps = np.diff(places)
    restart = np.diff(phase_s) != 0.0
    bridged = (jumps > 1) & (jumps <= LONGEST_FILL + 1) & ~restart & fill
    before = np.flatnonzero(bridged)
    holes = np.concatenate([np.arange(places[k] + 1, places[k + 1]) for k in before] or [np.empty(0, dtype=np.int64)])
    hole_phase = np.repeat(phase_s[before], jumps[before] - 1)
    everywhere = np.concatenate([places, holes])
    order = np.argsort(everywhere, kind="stable")
    rows = np.concatenate([kept, np.full(holes.size, -1, dtype=np.int64)])[order]
    everywhere, phase_s = everywhere[order], np.concatenate([phase_s, hole_phase])[order]
    starts = np.flatnonzero((np.diff(everywhere) > 1) | (np.diff(phase_s) != 0.0)) + 1
    return TimeBase(
        time_s=everywhere * period + phase_s,
        rows=rows,
        starts=(0, *(int(start) for start in starts)),
        rate_hz=1.0 / period,
        survey=survey,
    )
