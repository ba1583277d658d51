"""Opens HDF5 files that should be recordings and says in one line why one cannot be read."""

from __future__ import annotations

import os
import re
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np

from benchctl.recordings.model import Axis, Meta, Step, StepInfo, axis_of
from benchctl.recordings.schema import FORMAT, PART_SUFFIX, STEPS, group_name, read_info, read_meta
from instruments.errors import UsageError

_FAMILY, _VERSION = FORMAT.split("/")


class RecordingFile:
    """One HDF5 file of ours, open for reading: a recording, or a step of a campaign, finished or being written.

    Raises `UsageError` where the file is absent, is no HDF5, is not ours or newer than this program, or was cut short.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = open_ours(path)
        try:
            self.meta: Meta = read_meta(self._file)
            self.infos = tuple(sorted((self._info(name) for name in self._file[STEPS]), key=lambda info: info.index))
            self.digest = str(self._file.attrs.get("digest", ""))
        except (KeyError, TypeError, ValueError) as err:
            self._file.close()
            raise UsageError(f"{path}: its description is damaged ({err}); benchctl verify names what changed") from err

    def channels(self, index: int) -> tuple[str, ...]:
        """The names of a step's channels."""
        return tuple(_channels(self._file[group_name(index)]))

    def load(self, info: StepInfo, names: Collection[str] | None = None) -> Step:
        """A step with its samples, of these channels where given.

        Of a step being written: those samples that all channels of an axis have.
        """
        found = _channels(self._file[group_name(info.index)])
        lengths: dict[Axis, int] = {}
        for name, dataset in found.items():
            axis = axis_of(name)
            lengths[axis] = min(lengths.get(axis, len(dataset)), len(dataset))
        try:
            channels = {
                name: np.asarray(dataset[: lengths[axis_of(name)]])
                for name, dataset in found.items()
                if names is None or name in names
            }
        except OSError as err:
            raise UsageError(f"{self.path}: step {info.index} {info.name!r} cannot be read: {_one_line(err)}") from err
        return Step(info, channels)

    def close(self) -> None:
        """Let go of the file; safe to call twice."""
        self._file.close()

    def _info(self, name: str) -> StepInfo:
        """A step's description; of a step being written, as far as it has come."""
        group = self._file[STEPS][name]
        info = read_info(group)
        if group.name != f"/{group_name(info.index)}":
            raise ValueError(f"the group {group.name} says that its index is {info.index}")
        if self.path.name.endswith(PART_SUFFIX):
            info = _so_far(info, group)
        return info


def _channels(group: h5py.Group) -> dict[str, h5py.Dataset]:
    """The channels of a step; what others put beside them is theirs."""
    return {name: item for name, item in group.items() if isinstance(item, h5py.Dataset) and item.ndim == 1}


def _so_far(info: StepInfo, group: h5py.Group) -> StepInfo:
    """The description of a step being written, as far as it has come."""
    ends = [float(group[axis][-1]) for axis in ("time_s", "poll_time_s") if axis in group and len(group[axis])]
    samples = min((len(dataset) for name, dataset in group.items() if axis_of(name) == "time_s"), default=0)
    return replace(info, t_end=max([info.t_start, *ends]), samples=samples)


def open_ours(path: Path) -> h5py.File:
    """The HDF5 file itself, open for reading, whatever its description says; `UsageError` as for `RecordingFile`."""
    try:
        file = h5py.File(path, "r", swmr=path.name.endswith(PART_SUFFIX))
    except FileNotFoundError as err:
        raise UsageError(f"{path}: there is no such file; expected a recording (*.h5) or a campaign's folder") from err
    except OSError as err:
        raise UsageError(f"{path}: {_why(path, err)}") from err
    problem = _not_ours(file.attrs.get("format", ""))
    if problem or STEPS not in file:
        file.close()
        raise UsageError(f"{path}: {problem or 'is damaged: its steps are gone'}")
    return file


def _why(path: Path, err: OSError) -> str:
    """What HDF5 says of a file that it cannot open, said to a person."""
    if isinstance(err, PermissionError):
        return "may not be read by you; ask for the permission"
    size = path.stat().st_size
    short = re.search(r"truncated file.*stored_eof = (\d+)", str(err))
    if short:
        return f"was cut short: {size} of {short[1]} bytes are there; copy it again from where it came"
    if not h5py.is_hdf5(path):
        return f"is not an HDF5 file ({size} bytes); expected a recording; import other files (benchctl import)"
    if "already open for write" in str(err):
        return "is being written, or was when its program died; open its campaign's folder instead"
    return f"is damaged or was cut short, HDF5 cannot open its {size} bytes: {_one_line(err)}"


def _not_ours(found: object) -> str:
    """Why a file with this format is none that can be read; empty where it can."""
    family, _, version = found.partition("/") if isinstance(found, str) else ("", "", "")
    if family != _FAMILY:
        return f"is HDF5, but no recording of benchctl (no format {FORMAT!r}); import it (benchctl import)"
    if version != _VERSION:
        return f"has the format {found!r}, this benchctl reads {FORMAT!r}; update benchctl"
    return ""


def _one_line(err: OSError) -> str:
    return os.strerror(err.errno) if err.errno else " ".join(str(err).split())
