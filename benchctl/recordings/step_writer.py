"""Write one step of a running campaign, so that others can read it meanwhile and it remains readable after a crash.

While it is written the step is a `.part` file under HDF5's SWMR (single writer, multiple readers), which allows no new
attributes, and compression only with a loss of space at every flush. Therefore a step is finished by writing it again:
compressed, sealed, with its final description, under a temporary name that is renamed once it is on the disk. Only then
is the `.part` removed.

Appended samples wait as rows, one row per point, so that a point needs one call of `struct` and no array: one thread
adds points and blocks, another takes them out. A timer writes them to the file a fifth of a second after the first of
them arrived: samples before a silence are as safe as the others, and the caller need not check the clock. A step that
is over before this, as most are on a bench whose time jumps, is finished from memory.
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

    `added` and `written` count all rows that were ever added and written. One thread may add while another takes: a
    deque's two ends are safe, and each counter is changed by one thread.
    """

    def __init__(self, where: str, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self.added = self.written = 0
        self._where = where
        self._pack = struct.Struct(f"<{len(self.names)}d").pack
        self._rows: deque[bytes | memoryview] = deque()
        self._taken: list[bytes | memoryview] = []

    def add_point(self, point: Mapping[str, float]) -> None:
        """Add one sample of each channel; `UsageError` if one is missing, is not a number or was not announced."""
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
        """Add samples of each channel, copied from arrays of shape (n,), n equal; other channels are ignored."""
        rows = np.stack([channels[name] for name in self.names], axis=1)
        self._rows.append(rows.data)
        self.added += len(rows)

    def take(self) -> FloatArray:
        """Return the waiting rows, shape (n, channels), and again at each call until `let_go` marks them as written."""
        for _ in range(len(self._rows)):
            self._taken.append(self._rows.popleft())
        return np.frombuffer(b"".join(self._taken), dtype="<f8").reshape(-1, len(self.names))

    def let_go(self, rows: int) -> None:
        """Mark the rows that were taken last, `rows` in number, as written."""
        self._taken.clear()
        self.written += rows

    def _unfit(self, point: Mapping[str, float]) -> UsageError:
        return UsageError(f"{self._where}: expected all of {sorted(self.names)} together, got {sorted(point)}")


CLOSING_S_PER_SCAN = 1e-5
"""Wall time that a scan may take while its step's file is rewritten: twenty times the measured time."""

_FLUSH_AFTER_S = 0.2
"""Part of the half second that may be lost; the rest is for the flush itself, on a busy machine."""
_MOST_WAITING = 1 << 17
"""Maximum number of rows that are held back, whatever the time: 1 MiB per channel."""


def file_stem(info: StepInfo) -> str:
    """Return the name of a step's file without suffix: index and name, without characters unfit for file names."""
    return f"{info.index:04d}_{re.sub(r'[^A-Za-z0-9.+-]+', '_', info.name)[:60]}"


class StepWriter:
    """One step while it is written; created by `CampaignWriter.begin_step`.

    `info` is the description given at the start, `path` the `.part` file. Samples that one thread appends are in that
    file, for a reader and after a crash, within half a second of wall time. Raises `UsageError` if the disk refuses.
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
        """Add one sample of every channel of a time axis, channel -> value: much cheaper than arrays of one sample.

        Raises `UsageError` for channels that were not announced or do not fit together.
        """
        for axis, waiting in self._waiting.items():
            if axis in point:
                waiting.add_point(point)
                self._see_to_flush(waiting)
                return
        raise UsageError(f"{self._where}: expected a point with one of {list(self._waiting)}, got {sorted(point)}")

    def flush(self) -> None:
        """Write the appended samples to the file now."""
        with self._writing, disk_errors(self.path):
            if not self._open:
                raise UsageError(f"{self._where}: is over, nothing more can be written; begin a step for it")
            for waiting in self._waiting.values():
                if waiting.added > waiting.written:
                    self._write(waiting)
            self._file.flush()
            self._is_refused = False

    def _write(self, waiting: Waiting) -> None:
        """Write the waiting rows; if this fails halfway, the next attempt writes the same rows to the same place."""
        rows = waiting.take()
        reserve(self._file, rows.nbytes + len(waiting.names) * GROWING_CHUNK * rows.itemsize)
        begin, end = waiting.written, waiting.written + len(rows)
        for name, samples in zip(waiting.names, rows.T, strict=True):
            self._datasets[name].resize((end,))
            self._datasets[name][begin:] = samples
        self._end_s = max(self._end_s, float(rows[-1, 0]))
        waiting.let_go(len(rows))

    def _see_to_flush(self, waiting: Waiting) -> None:
        """Schedule the write of the waiting rows; write at once if there are many, or if the disk has refused them."""
        if self._is_refused or waiting.added - waiting.written >= _MOST_WAITING:
            self.flush()
        elif not self._is_timed:
            self._is_timed = True
            self._timer = threading.Timer(_FLUSH_AFTER_S, self._flush_in_time)
            self._timer.start()

    def _flush_in_time(self) -> None:
        self._is_timed = False  # before anything is taken: rows that come from now on set another timer
        try:
            self.flush()
        except Exception:
            self._is_refused = True  # the next append meets the same error and raises it

    def close(self, info: StepInfo) -> StepInfo:
        """Finish the step: `NNNN_name.h5.part` becomes `NNNN_name.h5`, sealed and on the disk.

        `info` is the final description of the step (`t_end`, `gaps`, …), with the index of its start; returns it with
        `samples` and `digest` as written.
        """
        if not self._open or info.index != self.info.index:
            raise UsageError(f"step {info.index} cannot be finished: step {self.info.index} is the last that was begun")
        samples = self._samples()
        try:
            with whole_file(self._finished) as temporary:
                with finished_file(temporary, self._meta) as file:
                    written = write_step(file, info, samples, self._meta)
                    seal_recording(file, meta_attributes(self._meta))
                if samples is self._datasets:  # the `.part` file, which is removed now, holds samples
                    require_intact(temporary)
        except BaseException:
            self.flush()  # the samples of an unfinished step remain in the `.part` file
            raise
        self.release()
        self.path.unlink()
        return written

    def _samples(self) -> Mapping[str, FloatArray | h5py.Dataset]:
        """Return all samples of the step: those in memory if none is in the file yet, else those in the file.

        Samples in memory continue to wait for the timer: a slow close loses no more than anything else.
        """
        with self._writing:
            if not any(waiting.written for waiting in self._waiting.values()):
                taken = [(waiting.names, waiting.take()) for waiting in self._waiting.values()]
                columns = {name: column for names, rows in taken for name, column in zip(names, rows.T, strict=True)}
                return {name: columns[name] for name in self._datasets}
        self.flush()
        return self._datasets

    def cut(self, info: StepInfo | None = None) -> StepInfo:
        """Finish an incomplete step: as `close`, with `whole=False`.

        Without `info`, the step ends at its last sample. An `info` with another index stores the step under that index
        and name, so that the step can be recorded again.
        """
        self.flush()
        cut = replace(info or replace(self.info, t_end=self._end_s), whole=False)
        if cut.index != self.info.index:
            self.info, self._finished = cut, self._finished.with_name(f"{file_stem(cut)}{FINISHED_SUFFIX}")
        return self.close(cut)

    def release(self) -> None:
        """Close the `.part` file unchanged, without finishing the step; safe to call twice."""
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
    """Return the channels that lie on this axis, beginning with the axis itself."""
    return [axis, *(name for name in channels if axis_of(name) == axis and name != axis)]
