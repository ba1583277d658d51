"""Channels over the time of a campaign for drawing, always from all samples.

A few samples are returned individually. For more, each pixel gets the minimum and maximum of all its samples: read from
the recording if the window contains up to two million, else taken from an overview of the channel, which is computed
once in the background and cached.
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
"""A range of samples of a stretch, end exclusive."""


class SeriesReader:
    """Returns views of channels; thread-safe. A context manager that closes itself."""

    def __init__(self, cache: Path) -> None:
        self._overviews = Overviews(cache)
        self._tracks: OrderedDict[tuple[Path, Stamp, str], Track] = OrderedDict()
        self._lock = threading.Lock()

    def view(self, path: Path, channel: str, from_s: float, to_s: float, pixels: int) -> dict[str, Any]:
        """Return a channel between two times, both included [s of the campaign's time], in this number of pixels.

        `exact`: the samples are returned individually, at most two per pixel. Else `low` and `high` are those of all
        samples from an entry of `t_s`, the start of a pixel, to the next; None without samples. `complete` is False
        while an overview is being computed: parts not yet covered are None, `done` is its progress, 0 to 1.

        Raises
        ------
        UsageError
            If the campaign cannot be read or has no such channel; if the window or the number of pixels is invalid.
        """
        _require_window(from_s, to_s, pixels)
        for attempt in range(1, _ATTEMPTS + 1):
            try:
                return self._view(contents_of(path), channel, from_s, to_s, pixels)
            except ChangedError:  # a step was finished, or all were assembled: the open file is gone
                if attempt == _ATTEMPTS:
                    raise UsageError(f"{path}: changes faster than it can be read; look again in a moment") from None
        raise AssertionError("the last attempt returns or raises")

    def prepare(self, path: Path) -> None:
        """Start to compute the overviews of a campaign's channels that need one, in the background.

        Raises `UsageError` if the campaign cannot be read.
        """
        contents = contents_of(path)
        for one in described(_names(contents), contents.meta):
            try:
                tracks = self._tracks_of(contents, one["name"])
            except ChangedError:
                return  # it is still running: viewing it computes the rest
            if sum(track.length for track in tracks) > MOST_SAMPLES:
                for track in tracks:
                    self._overviews.want(track, urgent=False)

    def close(self) -> None:
        """Stop the background threads; safe to call twice."""
        self._overviews.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _view(self, contents: Contents, channel: str, from_s: float, to_s: float, pixels: int) -> dict[str, Any]:
        tracks = self._tracks_of(contents, channel)
        found = {track.name: _within(track, from_s, to_s) for track in tracks}
        samples = sum(end - first for parts in found.values() for _, first, end in parts)
        response = {
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
            return response | _exact([part for track in tracks for part in found[track.name]])
        done = self._done(tracks)  # before drawing: an overview may have been finished since
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
                response["complete"] = False
            else:
                _read(envelope, rest)
                left -= missing
        if not response["complete"]:
            response["done"] = done
        return response | {
            "t_s": envelope.begins_s.tolist(),
            "low": or_none(envelope.low),
            "high": or_none(envelope.high),
        }

    def _fill(self, envelope: Envelope, track: Track) -> int:
        """Add the available part of a track's overview and request the rest; return the number of samples covered."""
        overview = self._overviews.of(track)
        if overview is None or not overview.complete:
            self._overviews.want(track, urgent=True)
        if overview is None:
            return 0
        if overview.failed:
            raise UsageError(overview.failed)
        return overview.fill(envelope, track)

    def _done(self, tracks: list[Track]) -> float:
        known = [(track.length, self._overviews.of(track)) for track in tracks]
        covered = sum(min(length, overview.samples) for length, overview in known if overview is not None)
        return covered / sum(length for length, _ in known)

    def _tracks_of(self, contents: Contents, channel: str) -> list[Track]:
        """Return the tracks of a channel; `UsageError` if no step has it."""
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
    """Return the samples of a track in a window."""
    parts = [(stretch, *stretch.within(from_s, to_s)) for stretch in track.stretches]
    return [part for part in parts if part[1] < part[2]]


def _behind(track: Track, covered: int, parts: list[Part]) -> list[Part]:
    """Return the parts of a track after its first `covered` samples."""
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
    """Return individual samples in the order of time."""
    read = [stride for stretch, first, end in parts for stride in stretch.strides(first, end)]
    time_s = np.concatenate([one for one, _ in read]) if read else np.empty(0)
    values = np.concatenate([one for _, one in read]) if read else np.empty(0)
    order = np.argsort(time_s, kind="stable")
    numbers = or_none(values[order])
    return {"t_s": time_s[order].tolist(), "low": numbers, "high": list(numbers)}
