"""A channel in one file of a campaign: its stretches per step, and their place on the time axis."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from benchctl.dashboard.data.channels import RATE, RateSamples, recorded_as
from benchctl.dashboard.data.contents import KnownFile
from benchctl.dashboard.data.stored import Samples, samples_of
from benchctl.recordings.hdf5_files import open_ours
from benchctl.recordings.model import StepInfo, axis_of
from benchctl.recordings.opening import open_growing
from benchctl_instruments.arrays import FloatArray

_PLACES = 1 << 14
"""Distance of the samples that are read in a search on an axis: a chunk."""

STRIDE = 1 << 17
"""Samples of time and channel that are in memory at once: 2 MiB."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """The samples of a channel in one step, and their times; `length` is common to both.

    `settled` of them are final while the step continues: the last rates still change with further samples.
    """

    info: StepInfo
    time_s: Samples
    values: Samples
    length: int
    settled: int
    first_s: float
    last_s: float

    def strides(self, first: int, end: int) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield times and values of a range of samples in parts."""
        for begin in range(first, end, STRIDE):
            until = min(begin + STRIDE, end)
            yield self.time_s.read(begin, until), self.values.read(begin, until)

    def within(self, from_s: float, to_s: float) -> tuple[int, int]:
        """Return the range of samples between two times, both included: first index, and end (exclusive)."""
        if not self.length or self.last_s < from_s or self.first_s > to_s:
            return 0, 0
        first = 0 if from_s <= self.first_s else self._place(from_s, after=False)
        end = self.length if to_s >= self.last_s else self._place(to_s, after=True)
        return first, max(first, end)

    def _place(self, instant_s: float, *, after: bool) -> int:
        """Return the first sample not before a time, or after it; reads only a few places of the axis."""
        starts = range(0, self.length, _PLACES)
        find = bisect_right if after else bisect_left
        number = find(starts, instant_s, key=lambda start: float(self.time_s.read(start, start + 1)[0]))
        first = max(0, number - 1) * _PLACES
        time_s = self.time_s.read(first, min(first + _PLACES, self.length))
        return first + int(np.searchsorted(time_s, instant_s, side="right" if after else "left"))


@dataclass(frozen=True, slots=True)
class Track:
    """A channel in one file, its stretches in the order of time; `name` identifies its content, not its path."""

    path: Path
    channel: str
    growing: bool
    name: str
    stretches: tuple[Stretch, ...]

    @property
    def length(self) -> int:
        """The number of samples in all stretches."""
        return sum(stretch.length for stretch in self.stretches)


def track_of(file: KnownFile, channel: str) -> Track:
    """Return a channel in a file, as far as it is written.

    Raises `UsageError` if the file or the channel in it cannot be read.
    """
    with open_growing(file.path) if file.growing else open_ours(file.path) as opened:
        found = (_stretch(opened, file, info, channel) for info in file.infos)
        stretches = [stretch for stretch in found if stretch is not None]
    stretches.sort(key=lambda one: one.first_s)
    if file.growing:  # another attempt at the step begins at another time
        content = f"{file.path} {stretches[0].first_s if stretches else ''}"
    else:
        content = file.digest or f"{file.path} {file.stamp}"
    return Track(file.path, channel, file.growing, f"{content} {channel}", tuple(stretches))


def _stretch(opened: h5py.File, file: KnownFile, info: StepInfo, channel: str) -> Stretch | None:
    """Return a channel in a step; None if the step does not contain it, or no sample."""
    recorded = recorded_as(channel, file.channels[info.index])
    if recorded is None:
        return None
    time_s = samples_of(file.path, opened, info.index, axis_of(recorded), file.stamp, growing=file.growing)
    values = samples_of(file.path, opened, info.index, recorded, file.stamp, growing=file.growing)
    length = settled = min(time_s.length, values.length)
    if channel == RATE and recorded != RATE:
        values = rates = RateSamples(time_s, values, info.sample_rate_hz)
        settled = max(0, length - rates.half)
    if not length:
        return None
    (first_s,), (last_s,) = time_s.read(0, 1), time_s.read(length - 1, length)
    return Stretch(info, time_s, values, length, settled, float(first_s), float(last_s))
