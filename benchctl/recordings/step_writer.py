"""Writes one step of a running campaign, so that others can read it meanwhile and a crash leaves it readable.

While it is written the step is a `.part` file under HDF5's SWMR (single writer, multiple readers), which admits
neither new attributes nor, without losing space at every flush, compression. So finishing a step means to write it
once more: compressed, sealed, with what became of it, under a temporary name that is renamed once it is on the disk.
Only then does the `.part` go.
"""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchctl.atomic import disk_errors, require_room, whole_file
from benchctl.recordings.digests import seal_recording
from benchctl.recordings.model import AXES, FloatArray, Meta, StepInfo, axis_of
from benchctl.recordings.schema import (
    FINISHED_SUFFIX,
    PART_SUFFIX,
    check_channels,
    check_names,
    create_growing_channels,
    group_name,
    write_info,
)
from benchctl.recordings.writer import new_file, write_step
from instruments.errors import UsageError

CLOSING_S_PER_SCAN = 1e-5
"""Wall time that a scan may take while its step's file is written once more: twenty times what was measured."""

_SWMR_LIBVER = ("v110", "v110")
_FLUSH_EVERY_S = 0.25
"""Half of what may be lost, so that a step fed every 0.25 s or less is never behind by more than 0.5 s."""
_FLUSH_SAMPLES = 1 << 17
"""Samples that are held back at most, whatever the time: 1 MiB a channel."""


def file_stem(info: StepInfo) -> str:
    """The name of a step's file without its suffix: index and name, with what file systems dislike replaced."""
    return f"{info.index:04d}_{re.sub(r'[^A-Za-z0-9.+-]+', '_', info.name)[:60]}"


class StepWriter:
    """One step while it is written; made by `CampaignWriter.begin_step`.

    `info` is the description given at the start, `path` the `.part` file. Raises `UsageError` where the disk refuses.
    """

    def __init__(self, folder: Path, info: StepInfo, channels: Sequence[str], meta: Meta) -> None:
        check_names(f"step {info.index} {info.name!r}", tuple(channels))
        self.info = info
        self.path = folder / f"{file_stem(info)}{PART_SUFFIX}"
        self._finished = folder / f"{file_stem(info)}{FINISHED_SUFFIX}"
        self._meta = meta
        self._pending: dict[str, list[FloatArray]] = {name: [] for name in channels}
        self._held = 0
        self._flushed_at = time.monotonic()
        self._end_s = info.t_start
        self._open = True
        require_room(self.path, 0)
        with disk_errors(self.path):
            self._file = new_file(self.path, meta, _SWMR_LIBVER)
            group = self._file.create_group(group_name(info.index), track_order=True)
            write_info(group, replace(info, whole=False, t_end=info.t_start))
            self._datasets = create_growing_channels(group, channels, meta)
            self._file.swmr_mode = True

    def append(self, channels: Mapping[str, FloatArray]) -> None:
        """Add samples: all channels of one time axis, or of several; arrays of shape (n,), n equal on an axis.

        They are in the file, for a reader and for a crash, within half a second of wall time as long as this is
        called at least every half second; `flush` does it at once. Raises `UsageError` for channels that were not
        announced or do not fit together.
        """
        where = f"step {self.info.index} {self.info.name!r}"
        check_channels(where, channels)
        for axis in AXES:
            given = {name for name in channels if axis_of(name) == axis}
            announced = {name for name in self._datasets if axis_of(name) == axis}
            if given and given != announced:
                raise UsageError(f"{where}: expected all of {sorted(announced)} together, got {sorted(given)}")
            if given and channels[axis].size:
                self._held = max(self._held, sum(map(len, self._pending[axis])) + channels[axis].size)
                self._end_s = max(self._end_s, float(channels[axis][-1]))
        for name, samples in channels.items():
            self._pending[name].append(samples.copy())
        if self._held >= _FLUSH_SAMPLES or time.monotonic() - self._flushed_at >= _FLUSH_EVERY_S:
            self.flush()

    def flush(self) -> None:
        """Put what was appended into the file now."""
        require_room(self.path, sum(samples.nbytes for waiting in self._pending.values() for samples in waiting))
        with disk_errors(self.path):
            for name, waiting in self._pending.items():
                if waiting:
                    dataset, samples = self._datasets[name], np.concatenate(waiting)
                    dataset.resize((len(dataset) + len(samples),))
                    dataset[-len(samples) :] = samples
                    waiting.clear()
            self._file.flush()
        self._held = 0
        self._flushed_at = time.monotonic()

    def close(self, info: StepInfo) -> StepInfo:
        """Finish the step: `NNNN_name.h5.part` becomes `NNNN_name.h5`, sealed and on the disk.

        `info` describes the step as it was in the end (`t_end`, `gaps`, …), with the index it began with; returns it
        with `samples` and `digest` as written.
        """
        if not self._open or info.index != self.info.index:
            raise UsageError(f"step {info.index} cannot be finished: step {self.info.index} is the last that was begun")
        self.flush()
        with whole_file(self._finished) as temporary, new_file(temporary, self._meta) as file:
            written = write_step(file, info, self._datasets, self._meta)
            seal_recording(file)
        self.release()
        self.path.unlink()
        return written

    def cut(self, info: StepInfo | None = None) -> StepInfo:
        """Finish a step that did not come to its end: as `close`, with `whole=False`.

        Without `info`, the step ends where its samples do.
        """
        return self.close(replace(info or replace(self.info, t_end=self._end_s), whole=False))

    def release(self) -> None:
        """Let go of the `.part` file as it is, without finishing the step; safe to call twice."""
        if self._open:
            self._open = False
            with disk_errors(self.path):
                self._file.close()

    @property
    def is_open(self) -> bool:
        """Whether the step can still take samples."""
        return self._open
