"""The samples of a campaign's steps as they arrive, and the latest reading of each quantity.

Each call yields the new samples of the step that is being written and of later ones. A step may grow, be finished under
another name, and be followed by others between two calls: no sample is omitted or repeated. Only new samples are read,
and a file is open only while it is read.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from benchctl.dashboard.data.channels import ANGLE, MADE, RATE, GrowingRate, recorded_as
from benchctl.dashboard.data.overviews import MOST_SAMPLES
from benchctl.recordings.descriptions import read_info
from benchctl.recordings.hdf5_files import open_ours
from benchctl.recordings.hdf5_guard import (
    child,
    child_group,
    is_channel,
    length_of,
    names_in,
    plain_errors,
)
from benchctl.recordings.model import Axis, StepInfo, axis_of
from benchctl.recordings.opening import open_growing
from benchctl.recordings.reader import campaign_files
from benchctl.recordings.schema import FINISHED_SUFFIX, PART_SUFFIX, STEPS
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

_STRIDE = 1 << 17


@dataclass(frozen=True, slots=True)
class News:
    """New samples of one step: channel -> array of shape (n,), n equal on an axis; `over` if they are its last ones."""

    info: StepInfo
    names: tuple[str, ...]
    channels: Mapping[str, FloatArray]
    over: bool


@dataclass(slots=True)
class _Read:
    """The number of samples read per axis of a step. `mtime_ns` is that of its file after complete reading."""

    taken: dict[str, int] = field(default_factory=dict)
    over: bool = False
    mtime_ns: int = -1
    is_checked: bool = False


class StepFeed:
    """Reads the files of a campaign's steps from now on: steps that are already finished are not read."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._steps = {_stem(path): _Read(over=True) for path in campaign_files(folder) if _is_finished(path)}

    def news(self) -> Iterator[News]:
        """Yield new samples; steps in the order of their files.

        Raises
        ------
        UsageError
            If a file cannot be read, for example while it is being created; the next call continues at the same place.
        """
        for path in campaign_files(self._folder):
            read = self._steps.setdefault(_stem(path), _Read())
            if not read.over:
                yield from self._news_of(path, read)

    def given(self, path: Path, axis: Axis) -> int | None:
        """Return the number of samples read so far on an axis of an unfinished step; None for a finished one."""
        read = self._steps.get(_stem(path))
        return None if read is None or read.over else read.taken.get(axis, 0)

    def _news_of(self, path: Path, read: _Read) -> Iterator[News]:
        try:
            mtime_ns = path.stat().st_mtime_ns
            if mtime_ns == read.mtime_ns:
                return
            with self._opened(path, read) as file, plain_errors():
                yield from _new_samples(file, read, over=_is_finished(path))
        except FileNotFoundError:  # it was finished in the meantime: the next call finds it
            return
        except (OSError, RuntimeError, ValueError) as err:
            raise UsageError(f"{path}: cannot be read yet: {' '.join(str(err).split())}") from err
        read.mtime_ns = mtime_ns

    def _opened(self, path: Path, read: _Read) -> h5py.File:
        if _is_finished(path) or not read.is_checked:
            read.is_checked = True
            return open_ours(path)
        return open_growing(path)


def _new_samples(file: h5py.File, read: _Read, *, over: bool) -> Iterator[News]:
    """Yield the unread samples of the only step in a file in parts, each at most as long as a view reads."""
    steps = child_group(file, STEPS)
    (name,) = names_in(steps)
    group = child_group(steps, name)
    info = read_info(group)
    found = {one: item for one in names_in(group) if is_channel(item := child(group, one))}
    lengths: dict[Axis, int] = {}
    for one, dataset in found.items():
        length = length_of(dataset)
        lengths[axis_of(one)] = min(lengths.get(axis_of(one), length), length)
    names = tuple(found)
    given = False
    for axis, length in lengths.items():
        first = max(read.taken.get(axis, 0), length - MOST_SAMPLES)
        for begin in range(first, length, _STRIDE):
            end = min(begin + _STRIDE, length)
            channels = {
                one: np.asarray(item[begin:end], dtype=np.float64)
                for one, item in found.items()
                if axis_of(one) == axis
            }
            read.taken[axis] = end
            given = True
            yield News(info, names, channels, over=False)
    if over or not given:
        read.over = over
        yield News(info, names, {}, over=over)


def _stem(path: Path) -> str:
    return path.name.removesuffix(PART_SUFFIX).removesuffix(FINISHED_SUFFIX)


def _is_finished(path: Path) -> bool:
    return not path.name.endswith(PART_SUFFIX)


NOISE_S = 1.0
_FEWEST = 10
_NONE: FloatArray = np.empty(0)
_CHANNELS = {
    "setpoint_c": MADE["setpoint_c"].of,
    "air_c": MADE["air_c"].of,
    "gyro_c": MADE["gyro_c"].of,
    "gyro_v": ("gyro_v", "poll_gyro_v"),
}
"""The quantities that are shown, and their channels."""

_OF_A_STEP = (RATE, "angle_deg")
"""Quantities that are unknown after the end of the step in which they were recorded."""


class Readings:
    """The latest values.

    `now_s` is the latest time of any sample [s of the campaign], `index` and `kind` are those of the step with the last
    samples, `streamed` is its number of scans so far, `recorded` whether it has any samples.
    """

    def __init__(self) -> None:
        self.now_s: float | None = None
        self.kind = ""
        self.index: int | None = None
        self.streamed = 0
        self.recorded = False
        self._values: dict[str, float] = {}
        self._rate = GrowingRate(None)
        self._noise_s = self._noise_v = np.empty(0)

    @property
    def values(self) -> dict[str, float | None]:
        """The latest value of each quantity; None if it is not known."""
        latest = {name: self._values.get(name) for name in (*_CHANNELS, *_OF_A_STEP)}
        return {**latest, "noise_v_rms": self._noise_v_rms()}

    @property
    def noise_says(self) -> str:
        """How the noise was computed."""
        if len(self._noise_v) < _FEWEST:
            return ""
        return f"rms of the third differences of gyro_v, over √20, of the last {len(self._noise_v)} samples (1 s)"

    def take(self, news: News) -> Iterator[tuple[str, FloatArray, FloatArray]]:
        """Process new samples; yield channels by the page's names, with times and values, shape (n,) each."""
        if news.info.index != self.index:
            self._begin(news)
        for channel in (*news.channels, *MADE):
            recorded = recorded_as(channel, news.names)
            if channel == RATE or recorded is None or recorded not in news.channels:
                continue
            time_s, values = news.channels[axis_of(recorded)], news.channels[recorded]
            if time_s.size:
                yield channel, time_s, values
        if ANGLE in news.channels:
            yield RATE, *self._told_rate(*self._rate.add(news.channels["time_s"], news.channels[ANGLE]))
        if news.over:
            yield RATE, *self._rate.finish()
        self._see(news)

    def _begin(self, news: News) -> None:
        self.index, self.kind = news.info.index, news.info.kind
        self.streamed, self.recorded = 0, False
        self._rate = GrowingRate(news.info.sample_rate_hz)
        self._noise_s = self._noise_v = np.empty(0)
        for name in _OF_A_STEP:
            self._values.pop(name, None)

    def _told_rate(self, time_s: FloatArray, rates: FloatArray) -> tuple[FloatArray, FloatArray]:
        if rates.size and math.isfinite(rates[-1]):
            self._values[RATE] = float(rates[-1])
        return time_s, rates

    def _see(self, news: News) -> None:
        for name, channels in _CHANNELS.items():
            for channel in channels:
                if len(values := news.channels.get(channel, _NONE)) and math.isfinite(values[-1]):
                    self._values[name] = float(values[-1])
        if len(angles := news.channels.get(ANGLE, _NONE)) and math.isfinite(angles[-1]):
            self._values["angle_deg"] = float(angles[-1])
        for axis in ("time_s", "poll_time_s", "frame_time_s"):
            if len(times := news.channels.get(axis, _NONE)) and math.isfinite(times[-1]):
                self.now_s = max(float(times[-1]), self.now_s or 0.0)
        self.recorded |= any(map(len, news.channels.values()))
        if "gyro_v" in news.channels:
            self.streamed += len(news.channels["gyro_v"])
            self._noise_s = np.concatenate((self._noise_s, news.channels["time_s"]))
            self._noise_v = np.concatenate((self._noise_v, news.channels["gyro_v"]))
            last = np.searchsorted(self._noise_s, self._noise_s[-1:] - NOISE_S, side="right")
            if last.size:
                self._noise_s, self._noise_v = self._noise_s[last[0] :], self._noise_v[last[0] :]

    def _noise_v_rms(self) -> float | None:
        if len(self._noise_v) < _FEWEST:
            return None
        # third differences suppress a sine's motion; for white noise their variance is 1 + 9 + 9 + 1 times its variance
        rms = float(np.sqrt(np.mean(np.square(np.diff(self._noise_v, 3)) / 20.0)))
        return rms if math.isfinite(rms) else None
