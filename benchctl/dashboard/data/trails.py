"""The recent part of each watched channel during recording: its latest samples, and older ones in larger blocks.

Each level holds some ten thousand rows: the first the samples themselves, each further one blocks of sixteen rows of
the level below. Therefore a few megabytes hold an hour of a fast channel or days of a slow one, and a view of any
duration has more rows than pixels. A block never spans a gap, so that its samples are within its times.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchctl.dashboard.data.channels import RATE, recorded_as
from benchctl.dashboard.data.contents import contents_of
from benchctl.dashboard.data.envelope import COLUMNS, COUNT, FANOUT, FIRST, LAST, LOW, Envelope, coarser, or_none
from benchctl.dashboard.data.overviews import MOST_SAMPLES
from benchctl.dashboard.data.readings import StepFeed
from benchctl.dashboard.data.stored import ChangedError
from benchctl.dashboard.data.tracks import Stretch, track_of
from benchctl.recordings.model import axis_of
from benchctl.recordings.runs import gaps
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

ROWS = 1 << 16
"""Minimum number of rows kept in a level: sixteen for each pixel of the widest page."""
_LEVELS = 5
_LATE = 3.0
"""Usual intervals by which a sample may be late: polls wait for the answers of other instruments."""


class Trail:
    """The trail of one channel. Samples that are not later than the previous ones are ignored."""

    def __init__(self) -> None:
        self._levels = [_Level() for _ in range(_LEVELS)]
        self.last_s = -np.inf
        self._usual_s = np.inf

    def add(self, time_s: FloatArray, values: FloatArray) -> None:
        """Add samples, each shape (n,), of one step."""
        for begin in range(0, len(time_s), ROWS):
            self._add(time_s[begin : begin + ROWS], values[begin : begin + ROWS])

    def _add(self, time_s: FloatArray, values: FloatArray) -> None:
        later = time_s > self.last_s
        if not later.all():
            time_s, values = time_s[later], values[later]
        if not time_s.size:
            return
        apart_s = np.diff(time_s, prepend=self.last_s)
        if len(apart_s) > 1:
            self._usual_s = float(np.median(apart_s[1:]))
        self.last_s = float(time_s[-1])
        rows = np.stack((time_s, time_s, values, values, np.ones(len(values))), axis=1)
        for number, part in enumerate(np.split(rows, np.flatnonzero(gaps(apart_s, self._usual_s, _LATE)))):
            if number:
                self.end_block()
            if len(part):
                self._put(part)

    def end_block(self) -> None:
        """Start new blocks for the next samples, after the end of a step or a gap."""
        for below, level in zip(self._levels, self._levels[1:], strict=False):
            if len(waiting := below.waiting()):
                level.append(coarser(waiting))
                below.folded = below.rows

    def view(self, from_s: float, to_s: float, pixels: int) -> dict[str, Any]:
        """Return the channel in a window as in `SeriesReader.view`: `t_s`, `low`, `high`; empty without samples."""
        rows = self._rows_since(from_s)
        rows = rows[: np.searchsorted(rows[:, LAST], to_s, side="right")]
        if len(rows) <= 2 * pixels and (rows[:, COUNT] == 1).all():
            numbers = or_none(rows[:, LOW])
            return {"t_s": rows[:, FIRST].tolist(), "low": numbers, "high": list(numbers)}
        envelope = Envelope(from_s, to_s, pixels)
        envelope.add_blocks(rows)
        begins_s = envelope.begins_s
        if rows[0, FIRST] < envelope.edges_s[1]:  # it is not known which part of a block on the border is inside
            begins_s[0] = rows[0, FIRST]
        return {
            "t_s": begins_s.tolist(),
            "low": or_none(envelope.low),
            "high": or_none(envelope.high),
        }

    @property
    def nbytes(self) -> int:
        """Memory used by the trail."""
        return sum(level.nbytes for level in self._levels)

    def _put(self, rows: FloatArray) -> None:
        for number, level in enumerate(self._levels):
            level.append(rows)
            if number + 1 == len(self._levels):
                return
            waiting = level.waiting()
            complete = len(waiting) - len(waiting) % FANOUT
            if not complete:
                return
            rows = coarser(waiting[:complete])
            level.folded += complete

    def _rows_since(self, from_s: float) -> FloatArray:
        """Return the rows since then of the finest level that reaches back so far, and those not yet in its blocks."""
        for number, level in enumerate(self._levels):
            if not level.dropped or level.begins_s <= from_s or number + 1 == len(self._levels):
                parts = [level.kept(), *(below.waiting() for below in reversed(self._levels[:number]))]
                return np.concatenate([part[np.searchsorted(part[:, FIRST], from_s) :] for part in parts])
        raise AssertionError("the last level is taken where no other is")


class _Level:
    """Rows in order; the oldest are dropped when there are twice as many as needed.

    `rows` counts all rows so far, `folded` those that are in blocks of the level above.
    """

    def __init__(self) -> None:
        self._array: FloatArray = np.empty((1024, COLUMNS))
        self._used = 0
        self.rows = self.folded = self.dropped = 0

    @property
    def nbytes(self) -> int:
        return self._array.nbytes

    @property
    def begins_s(self) -> float:
        return float(self._array[0, FIRST]) if self._used else np.inf

    def kept(self) -> FloatArray:
        return self._array[: self._used]

    def waiting(self) -> FloatArray:
        return self._array[self._used - (self.rows - self.folded) : self._used]

    def append(self, rows: FloatArray) -> None:
        if self._used + len(rows) > 2 * ROWS and self._used > ROWS:
            keep = max(ROWS, self.rows - self.folded)
            self.dropped += self._used - keep
            self._array[:keep] = self._array[self._used - keep : self._used].copy()
            self._used = keep
        if self._used + len(rows) > len(self._array):
            larger = np.empty((2 * (self._used + len(rows)), COLUMNS))
            larger[: self._used] = self._array[: self._used]
            self._array = larger
        self._array[self._used : self._used + len(rows)] = rows
        self._used += len(rows)
        self.rows += len(rows)


@dataclass(frozen=True, slots=True)
class Watch:
    """Channels over the last `window_s` seconds of the campaign's time, each in `pixels` pixels."""

    channels: tuple[str, ...]
    window_s: float
    pixels: int


_MOST_TRAILS = 24
_SHORTEST_S = 600.0
_NONE = Trail()


class Trails:
    """Trails by channel name, each at least as long as the longest window in which it is watched.

    If a window contains more samples than can be read at once, only the latest two million are available at first.
    """

    def __init__(self, folder: Path, feed: StepFeed) -> None:
        self._folder, self._feed = folder, feed
        self._trails: dict[str, tuple[Trail, float]] = {}

    def add(self, channel: str, time_s: FloatArray, values: FloatArray) -> None:
        """Add new samples of a channel, if it is watched."""
        if channel in self._trails:
            self._trails[channel][0].add(time_s, values)

    def step_over(self) -> None:
        """End all blocks at the end of a step."""
        for trail, _ in self._trails.values():
            trail.end_block()

    def watched(self, watches: Sequence[Watch], now_s: float) -> list[dict[str, Any]]:
        """Return for each watch its channels up to now; empty series for those that no step has."""
        self._begin_missing(watches, now_s)
        found: list[dict[str, Any]] = []
        for watch in watches:
            from_s = now_s - watch.window_s
            trails = {name: self._trails[name][0] if name in self._trails else _NONE for name in watch.channels}
            found.append({name: trail.view(from_s, now_s, watch.pixels) for name, trail in trails.items()})
        return found

    def _begin_missing(self, watches: Sequence[Watch], now_s: float) -> None:
        longest_s: dict[str, float] = {}
        for watch in watches:
            for name in watch.channels:
                longest_s[name] = max(longest_s.get(name, _SHORTEST_S), watch.window_s)
        if len(self._trails.keys() | longest_s.keys()) > _MOST_TRAILS:
            self._trails = {name: one for name, one in self._trails.items() if name in longest_s}
        for name, window_s in longest_s.items():
            if name not in self._trails or self._trails[name][1] > max(0.0, now_s - window_s):
                # read more than requested, because users tend to widen the window repeatedly
                from_s = max(0.0, now_s - 2.0 * window_s)
                with suppress(
                    UsageError, ChangedError, OSError
                ):  # a step is being finished: try again at the next call
                    self._trails[name] = self._begun(name, from_s), from_s

    def _begun(self, channel: str, from_s: float) -> Trail:
        """Return a trail with the samples recorded since a time and already yielded by the feed."""
        trail = Trail()
        parts = self._before(channel, from_s)
        left = MOST_SAMPLES
        taken = []
        for stretch, first, end in reversed(parts):
            first = max(first, end - left)
            left -= end - first
            taken.append((stretch, first, end))
        for stretch, first, end in reversed(taken):
            for time_s, values in stretch.strides(first, end):
                trail.add(time_s, values)
            trail.end_block()
        return trail

    def _before(self, channel: str, from_s: float) -> list[tuple[Stretch, int, int]]:
        contents = contents_of(self._folder)
        parts = []
        late = {piece.file.path: piece.file for piece in contents.pieces if piece.info.t_end >= from_s}
        for file in late.values():
            names = {name for info in file.infos for name in file.channels[info.index]}
            recorded = recorded_as(channel, names)
            if recorded is None:
                continue
            given = self._feed.given(file.path, axis_of(recorded))
            for stretch in track_of(file, channel).stretches:
                first, end = stretch.within(from_s, math.inf)
                if given is not None:
                    end = min(end, given, stretch.settled if channel == RATE else given)
                if first < end:
                    parts.append((stretch, first, end))
        return sorted(parts, key=lambda part: part[0].first_s)
