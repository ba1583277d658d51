"""The trails of the channels that somebody watches, each begun with what was recorded before anybody did."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from benchctl.dashboard.data.channels import RATE, recorded_as
from benchctl.dashboard.data.contents import contents_of
from benchctl.dashboard.data.overview import MOST_SAMPLES
from benchctl.dashboard.data.step_feed import StepFeed
from benchctl.dashboard.data.stored import ChangedError
from benchctl.dashboard.data.tracks import Stretch, track_of
from benchctl.dashboard.data.trail import Trail
from benchctl.dashboard.data.watch import Watch
from benchctl.recordings.model import axis_of
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

_MOST_TRAILS = 24
_SHORTEST_S = 600.0
_NONE = Trail()


class Trails:
    """Trails by the names of channels, each at least as long as the longest window in which it is watched.

    Of a channel that is faster than its window lets it be read at once, only the latest two million samples are there
    at first.
    """

    def __init__(self, folder: Path, feed: StepFeed) -> None:
        self._folder, self._feed = folder, feed
        self._trails: dict[str, tuple[Trail, float]] = {}

    def add(self, channel: str, time_s: FloatArray, values: FloatArray) -> None:
        """Take new samples of a channel, where it is watched."""
        if channel in self._trails:
            self._trails[channel][0].add(time_s, values)

    def step_over(self) -> None:
        """No block goes on into the next step."""
        for trail, _ in self._trails.values():
            trail.end_block()

    def watched(self, watches: Sequence[Watch], now_s: float) -> list[dict[str, Any]]:
        """For each watch its channels up to now; empty series for those that no step has."""
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
                # a little further than is asked for: who makes the window wider will do so again
                from_s = max(0.0, now_s - 2.0 * window_s)
                with suppress(UsageError, ChangedError, OSError):  # a step is being finished: at the next look, then
                    self._trails[name] = self._begun(name, from_s), from_s

    def _begun(self, channel: str, from_s: float) -> Trail:
        """A trail with what was recorded since some instant and has been given by the feed."""
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
