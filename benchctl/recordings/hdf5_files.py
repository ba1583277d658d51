"""Open HDF5 files that should be recordings, and explain in one line why one cannot be read."""

from __future__ import annotations

import errno
import math
import os
import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from benchctl.confined import hdf5_name, stat_of
from benchctl.limits import cut, require_file, require_memory, shown
from benchctl.recordings.descriptions import read_info, read_meta
from benchctl.recordings.digests import ReadDigests
from benchctl.recordings.hdf5_guard import (
    attribute,
    child,
    child_group,
    is_channel,
    is_own,
    length_of,
    names_in,
    plain_errors,
    require_harmless,
)
from benchctl.recordings.model import AXES, Axis, Meta, Step, StepInfo, axis_of
from benchctl.recordings.opening import fill, open_closed, open_growing
from benchctl.recordings.schema import FORMAT, PART_SUFFIX, STEPS, group_name
from benchctl.recordings.stored import SCANS_AT_ONCE, StoredStep
from benchctl.side_by_side import cores, in_order
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError, in_line, reason

_FAMILY, _VERSION = FORMAT.split("/")


class RecordingFile:
    """One benchctl HDF5 file, open for reading: a recording, or a step of a campaign, finished or being written.

    Samples are digested into `digests`, if given, while they are read. Raises `UsageError` if the file is absent, not
    HDF5, not written by benchctl, newer than this program, or truncated.
    """

    def __init__(self, path: Path, digests: ReadDigests | None = None) -> None:
        self.path = path
        self._digests = digests
        self._seen: dict[int, tuple[dict[str, h5py.Dataset], dict[Axis, int]]] = {}
        self._file = open_ours(path)
        try:
            self.meta: Meta = read_meta(self._file)
            steps = child_group(self._file, STEPS)
            infos = [self._info(steps, name) for name in names_in(steps)]
            if path.name.endswith(PART_SUFFIX):
                infos = [self._so_far(info) for info in infos]
            self.infos = tuple(sorted(infos, key=lambda info: info.index))
            self.digest = str(attribute(self._file, "digest", ""))
        except UsageError as err:
            self._file.close()
            raise UsageError(f"{path}: {str(err).removeprefix(f'{path}: ')}") from err
        except ValueError as err:
            self._file.close()
            raise UsageError(f"{path}: its description is damaged ({err}); benchctl verify names what changed") from err

    def channels(self, index: int) -> tuple[str, ...]:
        """Return the names of a step's channels."""
        return tuple(self._channels(index))

    def load(self, info: StepInfo, names: Collection[str] | None = None) -> Step:
        """Return a step with its samples, of these channels if given.

        From a step being written, only the samples that all channels of an axis had when the file was opened are read.
        Raises `UsageError` if a channel is damaged, is stored outside the file, claims more samples than its bytes can
        hold, or does not fit into memory.
        """
        found, lengths = self._checked(info)
        wanted = {name: lengths[axis_of(name)] for name in found if names is None or name in names}
        require_memory(self.path, 8 * sum(wanted.values()), f"step {info.index} {cut(info.name, 60)!r}")
        channels = {name: np.empty(length) for name, length in wanted.items()}
        stretches = [(name, start) for name, length in wanted.items() for start in range(0, length, SCANS_AT_ONCE)]

        def read(stretch: tuple[str, int]) -> None:
            name, start = stretch
            with self._reading(info, name):
                fill(found[name], start, channels[name][start : start + SCANS_AT_ONCE])

        # Threads are worthwhile only if there is something to unpack.
        workers = cores() if len(stretches) > len(wanted) else 1
        for _ in in_order(read, stretches, workers):
            pass
        if self._digests is not None:
            for name, samples in channels.items():
                self._digests.take(info.index, name, len(found[name]), 0, samples)
        return Step(info, channels)

    def stored(self, info: StepInfo) -> StoredStep:
        """Return a step whose samples are read one stretch at a time; reading raises what `load` raises about them."""
        found, lengths = self._checked(info)
        fill = partial(self._fill, info, found)
        scans, polls, frames = (lengths.get(axis, 0) for axis in AXES)
        return StoredStep(info, tuple(found), scans, fill, polls, frames)

    def _fill(self, info: StepInfo, found: dict[str, h5py.Dataset], name: str, start: int, samples: FloatArray) -> None:
        with self._reading(info, name):
            fill(found[name], start, samples)
        if self._digests is not None:
            self._digests.take(info.index, name, len(found[name]), start, samples)

    def _checked(self, info: StepInfo) -> tuple[dict[str, h5py.Dataset], dict[Axis, int]]:
        """Return the channels of a step, and the common number of samples of each axis at the first call."""
        if info.index in self._seen:
            return self._seen[info.index]
        found = self._channels(info.index)
        lengths: dict[Axis, int] = {}
        for name, dataset in found.items():
            axis = axis_of(name)
            with self._reading(info, name):
                length = length_of(dataset)
                lengths[axis] = min(lengths.get(axis, length), length)
        self._seen[info.index] = found, lengths
        return found, lengths

    def close(self) -> None:
        """Close the file; safe to call twice."""
        self._file.close()

    def _info(self, steps: h5py.Group, name: str) -> StepInfo:
        """Return a step's description."""
        try:
            group = child_group(steps, name)
            info = read_info(group)
            if f"{STEPS}/{name}" != group_name(info.index):
                raise ValueError(f"the group /{STEPS}/{name} states that its index is {info.index}")
            return info
        except ValueError as err:
            raise ValueError(f"step {shown(name)}: {err}") from err

    def _so_far(self, info: StepInfo) -> StepInfo:
        """Return the description of a step being written, with its present end and samples."""
        channels, lengths = self._checked(info)
        with plain_errors():
            ends = [float(channels[axis][length - 1]) for axis, length in lengths.items() if length]
        t_end = max([info.t_start, *(end for end in ends if math.isfinite(end))])
        return replace(info, t_end=t_end, samples=lengths.get("time_s", 0))

    def _channels(self, index: int) -> dict[str, h5py.Dataset]:
        """Return the channels of a step, in the order in which they are stored."""
        try:
            return _channels(child_group(child_group(self._file, STEPS), f"{index:04d}"))
        except ValueError as err:
            raise UsageError(
                f"{self.path}: step {index} cannot be read: {err}; benchctl verify names what changed"
            ) from err

    @contextmanager
    def _reading(self, info: StepInfo, channel: str) -> Iterator[None]:
        """Raise `UsageError` with the channel that could not be read, and the reason."""
        try:
            with plain_errors():
                yield
        except ValueError as err:
            step = f"step {info.index} {cut(info.name, 60)!r}"
            raise UsageError(
                f"{self.path}: {step} cannot be read: channel {channel}: {err}; benchctl verify names what changed"
            ) from err


def _channels(group: h5py.Group) -> dict[str, h5py.Dataset]:
    """Return the channels of a step; other items in its group are ignored."""
    items = {name: child(group, name) for name in names_in(group)}
    return {name: item for name, item in items.items() if is_channel(item)}


def open_ours(path: Path) -> h5py.File:
    """Open an HDF5 file for reading without reading its description; raises `UsageError` as `RecordingFile` does."""
    require_file(path)
    try:
        if not is_own(path):
            require_harmless(path)
    except OSError:  # explained below
        pass
    except ValueError as err:
        raise UsageError(f"{str(path)!r}: cannot be opened: {err}; copy it again from where it came") from err
    try:
        file = open_growing(path) if path.name.endswith(PART_SUFFIX) else open_closed(path)
    except FileNotFoundError as err:
        raise UsageError(f"{path}: there is no such file; expected a recording (*.h5) or a campaign's folder") from err
    except OSError as err:
        raise UsageError(f"{path}: {_why(path, err)}") from err
    except (ValueError, RuntimeError, MemoryError) as err:  # a NUL in the name; a header that HDF5 cannot handle
        raise UsageError(f"{str(path)!r}: cannot be opened: {cut(in_line(str(err)))}") from err
    try:
        problem = _not_ours(attribute(file, "format", "")) or _no_steps(file)
    except ValueError as err:
        problem = f"is damaged: {err}; copy it again from where it came"
    if problem:
        file.close()
        raise UsageError(f"{path}: {problem}")
    return file


def _no_steps(file: h5py.File) -> str:
    with plain_errors():
        if STEPS not in file:
            return "is damaged: its steps are gone; copy it again from where it came"
    child_group(file, STEPS)
    return ""


def _why(path: Path, err: OSError) -> str:
    """Return HDF5's reason why it cannot open a file, in words for a user."""
    if isinstance(err, PermissionError):
        return "may not be read by you; ask for the permission"
    if err.errno == errno.ELOOP:
        return f"cannot be opened: {reason(err)}"
    size = stat_of(path).st_size
    short = re.search(r"truncated file.*stored_eof = (\d+)", str(err))
    if short:
        return f"was cut short: {size} of {short[1]} bytes are there; copy it again from where it came"
    with hdf5_name(path) as name:
        is_hdf5 = h5py.is_hdf5(name)
    if not is_hdf5:
        return f"is not an HDF5 file ({size} bytes); expected a recording; import other files (benchctl import)"
    if "already open for write" in str(err):
        return "is being written, or was when its program died; open its campaign's folder instead"
    return (
        f"is damaged or was cut short, HDF5 cannot open its {size} bytes: {_one_line(err)}; "
        "copy it again from where it came"
    )


def _not_ours(found: object) -> str:
    """Return why a file with this format cannot be read; empty if it can."""
    family, _, version = found.partition("/") if isinstance(found, str) else ("", "", "")
    if family != _FAMILY:
        return f"is HDF5, but no recording of benchctl (no format {FORMAT!r}); import it (benchctl import)"
    if version != _VERSION:
        return f"has the format {shown(found)}, this benchctl reads {FORMAT!r}; update benchctl"
    return ""


def _one_line(err: OSError) -> str:
    return in_line(os.strerror(err.errno) if err.errno else str(err))
