"""The samples of a campaign's steps as they come: at each look those that are new, of the step being written and since.

A step may grow, be finished under another name, and be followed by others between two looks: nothing is left out, and
nothing given twice. Only what is new is read, and a file is open no longer than that takes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from benchctl.dashboard.data.overview import MOST_SAMPLES
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
    """New samples of one step: channel -> array of shape (n,), n equal on an axis; `over` with its last ones."""

    info: StepInfo
    names: tuple[str, ...]
    channels: Mapping[str, FloatArray]
    over: bool


@dataclass(slots=True)
class _Read:
    """How far a step has been read: of each axis so many samples. `mtime_ns` is its file's, when nothing was left."""

    taken: dict[str, int] = field(default_factory=dict)
    over: bool = False
    mtime_ns: int = -1
    is_checked: bool = False


class StepFeed:
    """Follows the files of a campaign's steps from now on: steps that are finished already are not read."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._steps = {_stem(path): _Read(over=True) for path in campaign_files(folder) if _is_finished(path)}

    def news(self) -> Iterator[News]:
        """What is new; steps in the order of their files.

        Raises
        ------
        UsageError
            Where a file cannot be read, as one that is only being made; the next look goes on where this one ended.
        """
        for path in campaign_files(self._folder):
            read = self._steps.setdefault(_stem(path), _Read())
            if not read.over:
                yield from self._news_of(path, read)

    def given(self, path: Path, axis: Axis) -> int | None:
        """How many samples of an axis have been given of a step that goes on; None of one that is over."""
        read = self._steps.get(_stem(path))
        return None if read is None or read.over else read.taken.get(axis, 0)

    def _news_of(self, path: Path, read: _Read) -> Iterator[News]:
        try:
            mtime_ns = path.stat().st_mtime_ns
            if mtime_ns == read.mtime_ns:
                return
            with self._opened(path, read) as file, plain_errors():
                yield from _new_samples(file, read, over=_is_finished(path))
        except FileNotFoundError:  # it was finished since the folder was looked at: the next look finds it
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
    """What of the one step in a file has not been given yet, a stretch at a time, but no more than a view reads."""
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
