"""Writes one step of a running campaign, so that others can read it meanwhile and a crash leaves it readable.

While it is written the step is a `.part` file under HDF5's SWMR (single writer, multiple readers), which admits
neither new attributes nor, without losing space at every flush, compression. So finishing a step means to write it
once more: compressed, sealed, with what became of it, under a temporary name that is renamed once it is on the disk.
Only then does the `.part` go.

Appended samples wait as rows, a point a row, so that a point costs a call of `struct` and no array: one thread adds
points and blocks, another takes them out. They go into the file a fifth of a second after the first of them came, by a
timer: what came before a silence is as safe as the rest, and whoever appends need not look at the clock. A step that is
over by then, as most are on a bench whose time jumps, is finished from memory.
"""

from __future__ import annotations

import re
import struct
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np

from benchctl.atomic import disk_errors, whole_file
from benchctl.recordings.digests import seal_recording
from benchctl.recordings.model import AXES, Axis, Meta, StepInfo, axis_of
from benchctl.recordings.opening import reserve
from benchctl.recordings.schema import (
    FINISHED_SUFFIX,
    GROWING_CHUNK,
    PART_SUFFIX,
    check_channels,
    check_names,
    create_growing_channels,
    group_name,
    info_attributes,
    meta_attributes,
    write_attributes,
)
from benchctl.recordings.writer import finished_file, new_file, require_intact, write_step
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError


class Waiting:
    """Rows of these channels of a step, all on one axis; `where` names the step in errors.

    `added` and `written` count all rows that ever came and went. One thread may add while another takes: a deque's two
    ends are safe, and each counter has one thread that changes it.
    """

    def __init__(self, where: str, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self.added = self.written = 0
        self._where = where
        self._pack = struct.Struct(f"<{len(self.names)}d").pack
        self._rows: deque[bytes | memoryview] = deque()
        self._taken: list[bytes | memoryview] = []

    def add_point(self, point: Mapping[str, float]) -> None:
        """Add one sample of each channel; `UsageError` where one is missing, is no number or was not announced."""
        try:
            row = self._pack(*[point[name] for name in self.names])
        except KeyError:
            raise self._unfit(point) from None
        except (struct.error, TypeError) as err:
            raise UsageError(f"{self._where}: expected a point with one number a channel, got {dict(point)}") from err
        if len(point) > len(self.names):
            raise self._unfit(point)
        self._rows.append(row)
        self.added += 1

    def add_block(self, channels: Mapping[str, FloatArray]) -> None:
        """Add samples of each channel, copied from arrays of shape (n,), n equal; others may be among them."""
        rows = np.stack([channels[name] for name in self.names], axis=1)
        self._rows.append(rows.data)
        self.added += len(rows)

    def take(self) -> FloatArray:
        """The rows that wait, shape (n, channels); they are taken again until `let_go` says that they are written."""
        for _ in range(len(self._rows)):
            self._taken.append(self._rows.popleft())
        return np.frombuffer(b"".join(self._taken), dtype="<f8").reshape(-1, len(self.names))

    def let_go(self, rows: int) -> None:
        """What was taken last, so many rows, is written."""
        self._taken.clear()
        self.written += rows

    def _unfit(self, point: Mapping[str, float]) -> UsageError:
        return UsageError(f"{self._where}: expected all of {sorted(self.names)} together, got {sorted(point)}")


CLOSING_S_PER_SCAN = 1e-5
"""Wall time that a scan may take while its step's file is rewritten: twenty times what was measured."""

_FLUSH_AFTER_S = 0.2
"""Of the half second that may be lost; the rest is for the flush itself, on a busy machine."""
_MOST_WAITING = 1 << 17
"""Rows that are held back at most, whatever the time: 1 MiB a channel."""


def file_stem(info: StepInfo) -> str:
    """The name of a step's file without its suffix: index and name, with what file systems dislike replaced."""
    return f"{info.index:04d}_{re.sub(r'[^A-Za-z0-9.+-]+', '_', info.name)[:60]}"


class StepWriter:
    """One step while it is written; made by `CampaignWriter.begin_step`.

    `info` is the description given at the start, `path` the `.part` file. What one thread appends is in that file, for
    a reader and for a crash, within half a second of wall time. Raises `UsageError` where the disk refuses.
    """

    def __init__(self, folder: Path, info: StepInfo, channels: Sequence[str], meta: Meta) -> None:
        self._where = f"step {info.index} {info.name!r}"
        check_names(self._where, tuple(channels))
        self.info = info
        self.path = folder / f"{file_stem(info)}{PART_SUFFIX}"
        self._finished = folder / f"{file_stem(info)}{FINISHED_SUFFIX}"
        self._meta = meta
        self._waiting = {axis: Waiting(self._where, _on(axis, channels)) for axis in AXES if axis in channels}
        self._end_s = info.t_start
        self._open = True
        self._writing = threading.Lock()
        self._timer: threading.Timer | None = None
        self._is_timed = self._is_refused = False
        with disk_errors(self.path):
            self._file = new_file(self.path, meta, growing=True)
            group = self._file.create_group(group_name(info.index), track_order=True)
            write_attributes(group, info_attributes(replace(info, whole=False, t_end=info.t_start)))
            self._datasets = create_growing_channels(group, channels, meta)
            self._file.swmr_mode = True

    def append(self, channels: Mapping[str, FloatArray]) -> None:
        """Add samples: all channels of one time axis, or of several; arrays of shape (n,), n equal on an axis.

        Raises `UsageError` for channels that were not announced or do not fit together.
        """
        check_channels(self._where, channels)
        given = [waiting for axis, waiting in self._waiting.items() if axis in channels]
        expected = [name for waiting in given for name in waiting.names]
        if channels.keys() != set(expected):
            raise UsageError(
                f"{self._where}: expected all of {sorted(expected or self._datasets)} together, got {sorted(channels)}"
            )
        for waiting in given:
            waiting.add_block(channels)
            self._see_to_flush(waiting)

    def append_point(self, point: Mapping[str, float]) -> None:
        """Add one sample of every channel of a time axis, channel -> value: far cheaper than arrays of one sample.

        Raises `UsageError` for channels that were not announced or do not fit together.
        """
        for axis, waiting in self._waiting.items():
            if axis in point:
                waiting.add_point(point)
                self._see_to_flush(waiting)
                return
        raise UsageError(f"{self._where}: expected a point with one of {list(self._waiting)}, got {sorted(point)}")

    def flush(self) -> None:
        """Put what was appended into the file now."""
        with self._writing, disk_errors(self.path):
            if not self._open:
                raise UsageError(f"{self._where}: is over, nothing more can be written; begin a step for it")
            for waiting in self._waiting.values():
                if waiting.added > waiting.written:
                    self._write(waiting)
            self._file.flush()
            self._is_refused = False

    def _write(self, waiting: Waiting) -> None:
        """Write what waits; where that fails halfway, the next attempt writes the same rows to the same place."""
        rows = waiting.take()
        reserve(self._file, rows.nbytes + len(waiting.names) * GROWING_CHUNK * rows.itemsize)
        begin, end = waiting.written, waiting.written + len(rows)
        for name, samples in zip(waiting.names, rows.T, strict=True):
            self._datasets[name].resize((end,))
            self._datasets[name][begin:] = samples
        self._end_s = max(self._end_s, float(rows[-1, 0]))
        waiting.let_go(len(rows))

    def _see_to_flush(self, waiting: Waiting) -> None:
        """Have what waits written in time; at once where it is much, or where the disk has refused it."""
        if self._is_refused or waiting.added - waiting.written >= _MOST_WAITING:
            self.flush()
        elif not self._is_timed:
            self._is_timed = True
            self._timer = threading.Timer(_FLUSH_AFTER_S, self._flush_in_time)
            self._timer.start()

    def _flush_in_time(self) -> None:
        self._is_timed = False  # before anything is taken: what comes from now on sets a timer of its own
        try:
            self.flush()
        except Exception:
            self._is_refused = True  # the next append meets the same error and raises it

    def close(self, info: StepInfo) -> StepInfo:
        """Finish the step: `NNNN_name.h5.part` becomes `NNNN_name.h5`, sealed and on the disk.

        `info` describes the step as it was in the end (`t_end`, `gaps`, …), with the index it began with; returns it
        with `samples` and `digest` as written.
        """
        if not self._open or info.index != self.info.index:
            raise UsageError(f"step {info.index} cannot be finished: step {self.info.index} is the last that was begun")
        samples = self._samples()
        try:
            with whole_file(self._finished) as temporary:
                with finished_file(temporary, self._meta) as file:
                    written = write_step(file, info, samples, self._meta)
                    seal_recording(file, meta_attributes(self._meta))
                if samples is self._datasets:  # the `.part` file, which goes now, holds samples
                    require_intact(temporary)
        except BaseException:
            self.flush()  # what could not be finished is to be found in the `.part` file
            raise
        self.release()
        self.path.unlink()
        return written

    def _samples(self) -> Mapping[str, FloatArray | h5py.Dataset]:
        """All samples of the step: those in memory where none is in the file yet, else those in the file.

        What is in memory waits there on, for the timer: a closing that takes its time loses no more than anything else.
        """
        with self._writing:
            if not any(waiting.written for waiting in self._waiting.values()):
                taken = [(waiting.names, waiting.take()) for waiting in self._waiting.values()]
                columns = {name: column for names, rows in taken for name, column in zip(names, rows.T, strict=True)}
                return {name: columns[name] for name in self._datasets}
        self.flush()
        return self._datasets

    def cut(self, info: StepInfo | None = None) -> StepInfo:
        """Finish a step that did not come to its end: as `close`, with `whole=False`.

        Without `info`, the step ends where its samples do. An `info` with another index files it under that index and
        its name, so that the step can be recorded again.
        """
        self.flush()
        cut = replace(info or replace(self.info, t_end=self._end_s), whole=False)
        if cut.index != self.info.index:
            self.info, self._finished = cut, self._finished.with_name(f"{file_stem(cut)}{FINISHED_SUFFIX}")
        return self.close(cut)

    def release(self) -> None:
        """Close the `.part` file as it is, without finishing the step; safe to call twice."""
        if self._timer is not None:
            self._timer.cancel()
        with self._writing, disk_errors(self.path):
            self._open = False
            self._file.close()

    @property
    def is_open(self) -> bool:
        """Whether the step can still take samples."""
        return self._open


def _on(axis: Axis, channels: Sequence[str]) -> list[str]:
    """Those of the channels that lie on this axis, which is the first of them."""
    return [axis, *(name for name in channels if axis_of(name) == axis and name != axis)]
