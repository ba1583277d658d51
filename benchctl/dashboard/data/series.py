"""Channels over the time of a campaign, as a page draws them: never a choice among samples.

Few samples are given one by one. Of more each pixel gets the lowest and the highest of all samples in it: read from the
recording where the window holds up to two million, else taken from an overview of the channel, which is made once, in
the background, and kept in the cache.
"""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from pathlib import Path
from typing import Any, Self

import numpy as np

from benchctl.dashboard.data.channels import described, recorded_as, unit_in_words
from benchctl.dashboard.data.contents import Contents, KnownFile, contents_of
from benchctl.dashboard.data.envelope import Envelope, or_none
from benchctl.dashboard.data.overviews import MOST_SAMPLES, Overviews
from benchctl.dashboard.data.stored import ChangedError, Stamp
from benchctl.dashboard.data.tracks import Stretch, Track, track_of
from benchctl.limits import listed
from benchctl_instruments.errors import UsageError

MOST_PIXELS = 4000
_MOST_TRACKS = 8192
_ATTEMPTS = 5

Part = tuple[Stretch, int, int]
"""Some samples of a stretch: from the first until before the second."""


class SeriesReader:
    """Gives views of channels; any thread may ask. `with` closes it."""

    def __init__(self, cache: Path) -> None:
        self._overviews = Overviews(cache)
        self._tracks: OrderedDict[tuple[Path, Stamp, str], Track] = OrderedDict()
        self._lock = threading.Lock()

    def view(self, path: Path, channel: str, from_s: float, to_s: float, pixels: int) -> dict[str, Any]:
        """A channel from one instant to another, both included [s of the campaign's time], in so many pixels.

        `exact`: each sample by itself, there being at most two a pixel. Else `low` and `high` are those of all samples
        from an entry of `t_s`, which is when a pixel begins, to the next; None where there is none. `complete` is False
        while an overview is being made: what it does not cover yet is None, `done` is how far it has come, 0 to 1.

        Raises
        ------
        UsageError
            The campaign cannot be read or has no such channel; the window or the pixels are none.
        """
        _require_window(from_s, to_s, pixels)
        for attempt in range(1, _ATTEMPTS + 1):
            try:
                return self._view(contents_of(path), channel, from_s, to_s, pixels)
            except ChangedError:  # a step was finished, or all were gathered: what was open is not there any more
                if attempt == _ATTEMPTS:
                    raise UsageError(f"{path}: changes faster than it can be read; look again in a moment") from None
        raise AssertionError("the last attempt returns or raises")

    def prepare(self, path: Path) -> None:
        """Begin to make the overviews of a campaign's channels, those that need one, in the background.

        Raises `UsageError` where the campaign cannot be read.
        """
        contents = contents_of(path)
        for one in described(_names(contents), contents.meta):
            try:
                tracks = self._tracks_of(contents, one["name"])
            except ChangedError:
                return  # it goes on: whoever views it sees to the rest
            if sum(track.length for track in tracks) > MOST_SAMPLES:
                for track in tracks:
                    self._overviews.want(track, urgent=False)

    def close(self) -> None:
        """Stop what goes on in the background; safe to call twice."""
        self._overviews.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _view(self, contents: Contents, channel: str, from_s: float, to_s: float, pixels: int) -> dict[str, Any]:
        tracks = self._tracks_of(contents, channel)
        found = {track.name: _within(track, from_s, to_s) for track in tracks}
        samples = sum(end - first for parts in found.values() for _, first, end in parts)
        said = {
            "channel": channel,
            "unit": unit_in_words(channel, contents.meta),
            "from_s": from_s,
            "to_s": to_s,
            "exact": samples <= 2 * pixels,
            "complete": True,
            "done": 1.0,
            "samples": samples,
        }
        if samples <= 2 * pixels:
            return said | _exact([part for track in tracks for part in found[track.name]])
        done = self._done(tracks)  # before it is drawn: by what is shown, an overview may have been finished since
        envelope = Envelope(from_s, to_s, pixels)
        left = MOST_SAMPLES
        for track in tracks:
            parts = found[track.name]
            count = sum(end - first for _, first, end in parts)
            if samples <= MOST_SAMPLES or not count:
                _read(envelope, parts)
                continue
            known = self._fill(envelope, track)
            rest = _behind(track, known, parts)
            missing = sum(end - first for _, first, end in rest)
            if missing > left:
                said["complete"] = False
            else:
                _read(envelope, rest)
                left -= missing
        if not said["complete"]:
            said["done"] = done
        return said | {
            "t_s": envelope.begins_s.tolist(),
            "low": or_none(envelope.low),
            "high": or_none(envelope.high),
        }

    def _fill(self, envelope: Envelope, track: Track) -> int:
        """Put in what a track's overview covers by now, and have it made further; how many samples it covers."""
        overview = self._overviews.of(track)
        if overview is None or not overview.complete:
            self._overviews.want(track, urgent=True)
        if overview is None:
            return 0
        if overview.failed:
            raise UsageError(overview.failed)
        try:
            return overview.fill(envelope, track)
        except OSError as err:  # thrown out of the cache
            self._overviews.forget(track)
            raise ChangedError(track.path) from err

    def _done(self, tracks: list[Track]) -> float:
        known = [(track.length, self._overviews.of(track)) for track in tracks]
        covered = sum(min(length, overview.samples) for length, overview in known if overview is not None)
        return covered / sum(length for length, _ in known)

    def _tracks_of(self, contents: Contents, channel: str) -> list[Track]:
        """The tracks of a channel; `UsageError` where no step has it."""
        files = dict.fromkeys(
            piece.file.path for piece in contents.pieces if recorded_as(channel, piece.channels) is not None
        )
        if not files:
            names = [one["name"] for one in described(_names(contents), contents.meta)]
            raise UsageError(f"{contents.path}: has no channel {channel!r}; it has {listed(names)}")
        by_path = {piece.file.path: piece.file for piece in contents.pieces}
        return [self._track(by_path[path], channel) for path in files]

    def _track(self, file: KnownFile, channel: str) -> Track:
        key = file.path, file.stamp, channel
        with self._lock:
            if key in self._tracks:
                self._tracks.move_to_end(key)
                return self._tracks[key]
        try:
            track = track_of(file, channel)
        except (UsageError, OSError) as err:
            if file.growing or not file.path.exists():
                raise ChangedError(file.path) from err
            raise
        if not file.growing:
            with self._lock:
                self._tracks[key] = track
                while len(self._tracks) > _MOST_TRACKS:
                    self._tracks.popitem(last=False)
        return track


def _require_window(from_s: float, to_s: float, pixels: int) -> None:
    if not (math.isfinite(from_s) and math.isfinite(to_s) and from_s < to_s):
        raise UsageError(f"a window from {from_s} to {to_s} s is none; expected two instants, the earlier one first")
    if not 1 <= pixels <= MOST_PIXELS:
        raise UsageError(f"{pixels} pixels: expected 1 to {MOST_PIXELS}")


def _names(contents: Contents) -> list[str]:
    return list(dict.fromkeys(name for piece in contents.pieces for name in piece.channels))


def _within(track: Track, from_s: float, to_s: float) -> list[Part]:
    """The samples of a track in a window."""
    parts = [(stretch, *stretch.within(from_s, to_s)) for stretch in track.stretches]
    return [part for part in parts if part[1] < part[2]]


def _behind(track: Track, covered: int, parts: list[Part]) -> list[Part]:
    """Of some parts of a track what lies behind its first `covered` samples."""
    begins, begin = {}, 0
    for stretch in track.stretches:
        begins[stretch.info.index] = begin
        begin += stretch.length
    rest = [(stretch, max(first, covered - begins[stretch.info.index]), end) for stretch, first, end in parts]
    return [part for part in rest if part[1] < part[2]]


def _read(envelope: Envelope, parts: list[Part]) -> None:
    for stretch, first, end in parts:
        for time_s, values in stretch.strides(first, end):
            envelope.add_samples(time_s, values)


def _exact(parts: list[Part]) -> dict[str, Any]:
    """Samples one by one, in the order of time."""
    read = [stride for stretch, first, end in parts for stride in stretch.strides(first, end)]
    time_s = np.concatenate([one for one, _ in read]) if read else np.empty(0)
    values = np.concatenate([one for _, one in read]) if read else np.empty(0)
    order = np.argsort(time_s, kind="stable")
    told = or_none(values[order])
    return {"t_s": time_s[order].tolist(), "low": told, "high": list(told)}
