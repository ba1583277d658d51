"""Overviews of tracks: blocks of samples, computed in two background threads, and cached for large recordings."""

from __future__ import annotations

import itertools
import queue
import threading
from collections import OrderedDict
from contextlib import suppress
from pathlib import Path

import numpy as np

from benchctl.dashboard.data.cached import Cache
from benchctl.dashboard.data.envelope import BLOCK, COLUMNS, Envelope, Pyramid, Run, blocks_of
from benchctl.dashboard.data.stored import ChangedError
from benchctl.dashboard.data.tracks import Track
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

MOST_SAMPLES = 2_000_000
"""Maximum number of samples that a view reads from a recording: 0.2 s."""


class Blocks:
    """Blocks of a track, in memory, where more can be appended, or mapped from a file of the cache."""

    def __init__(self, mapped: FloatArray | None = None) -> None:
        self._rows: FloatArray = np.empty((0, COLUMNS)) if mapped is None else mapped
        self.rows = len(self._rows)

    def append(self, rows: FloatArray) -> None:
        """Append blocks, shape (n, 5)."""
        if self.rows + len(rows) > len(self._rows):
            larger = np.empty((2 * self.rows + len(rows), COLUMNS))
            larger[: self.rows] = self._rows[: self.rows]
            self._rows = larger
        self._rows[self.rows : self.rows + len(rows)] = rows
        self.rows += len(rows)

    def read(self, first: int, end: int) -> FloatArray:
        """Return blocks, shape (end - first, 5)."""
        return np.asarray(self._rows[first:end])

    @property
    def nbytes(self) -> int:
        """Memory used by the blocks."""
        return 0 if isinstance(self._rows, np.memmap) else self._rows.nbytes


class Overview:
    """The blocks of a track up to some sample; one thread may extend it while others read it.

    `failed` is the reason why it cannot be computed, or empty.
    """

    def __init__(self, blocks: Blocks, *, failed: str = "") -> None:
        self.blocks = blocks
        self._pyramid = Pyramid(blocks.read)
        self._lock = threading.Lock()
        self.samples = 0
        self.complete = False
        self.failed = failed

    @property
    def nbytes(self) -> int:
        """Memory used by the overview."""
        return self._pyramid.nbytes + self.blocks.nbytes

    def reached(self, blocks: int, samples: int, *, complete: bool = False) -> None:
        """Set the number of available blocks, and the number of samples in them."""
        with self._lock:
            self._pyramid.extend(blocks)
            self.samples, self.complete = samples, complete

    def fill(self, envelope: Envelope, track: Track) -> int:
        """Add all available blocks of an envelope's window to it; return the number of samples of the track covered.

        Raises
        ------
        UsageError
            If the times of the track do not ascend: most blocks would have to be read completely.
        """
        with self._lock:
            waiting, samples = self._pyramid.fill(envelope), self.samples
        if BLOCK * sum(end - first for first, end in waiting) > MOST_SAMPLES:
            raise UsageError(f"{track.path}: the times of channel {track.channel} do not ascend; it cannot be drawn")
        for first, end in waiting:
            _read_whole(envelope, track, (first, end))
        return samples


def _read_whole(envelope: Envelope, track: Track, run: Run) -> None:
    """Add the samples of some blocks individually."""
    begin = 0
    for stretch in track.stretches:
        end = begin + -(-stretch.length // BLOCK)
        first, last = max(run[0], begin), min(run[1], end)
        if first < last:
            for time_s, values in stretch.strides((first - begin) * BLOCK, min((last - begin) * BLOCK, stretch.length)):
                envelope.add_samples(time_s, values)
        begin = end


_THREADS = 2
_KEPT_FROM = 1 << 19
"""Number of samples from which an overview is cached; smaller ones are computed as fast as read."""
_MOST_MEMORY = 256 << 20
_URGENT, _SOME_TIME, _NEVER = 1, 2, 3
_LAST = 0, 0
"""The priority of the entry that ends a thread: the highest."""


class _StoppedError(Exception):
    """The page is closed."""


class Overviews:
    """The overviews of tracks: those available, and those being computed."""

    def __init__(self, cache: Path) -> None:
        self._cache = Cache(cache / "overviews")
        self._known: OrderedDict[str, Overview] = OrderedDict()
        self._asked: dict[str, int] = {}
        self._busy: set[str] = set()
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._number = itertools.count(1)
        self._queue: queue.PriorityQueue[tuple[int, int, Track | None]] = queue.PriorityQueue()
        self._threads: list[threading.Thread] = []

    def of(self, track: Track) -> Overview | None:
        """Return the current overview of a track; None if there is none."""
        with self._lock:
            found = self._known.get(track.name)
            if found is not None:
                self._known.move_to_end(track.name)
                return found
        if track.growing or track.length < _KEPT_FROM or (rows := self._cache.find(track.name)) is None:
            return None
        found = Overview(Blocks(rows))
        found.reached(len(rows), track.length, complete=True)
        return self._keep(track.name, found)

    def want(self, track: Track, *, urgent: bool) -> None:
        """Request the computation of an overview, or its extension; urgent ones come first."""
        turn = _URGENT if urgent else _SOME_TIME
        with self._lock:
            if self._stop.is_set() or self._asked.get(track.name, _NEVER) <= turn:
                return
            self._asked[track.name] = turn
            number = next(self._number)
            self._queue.put((turn, -number if urgent else number, track))  # the last requested one comes first
            if len(self._threads) < _THREADS:
                thread = threading.Thread(target=self._work, name="overview", daemon=True)
                self._threads.append(thread)
                thread.start()

    def close(self) -> None:
        """Stop the threads; incomplete overviews are computed again next time. Safe to call twice."""
        self._stop.set()
        for _ in self._threads:
            self._queue.put((*_LAST, None))
        for thread in self._threads:
            thread.join()
        self._threads.clear()

    def _work(self) -> None:
        while True:
            _, _, track = self._queue.get()
            if track is None or self._stop.is_set():
                return
            with self._lock:
                self._asked.pop(track.name, None)
                if track.name in self._busy:  # by the other thread
                    continue
                self._busy.add(track.name)
            try:
                self._make(track)
            except (ChangedError, _StoppedError):
                pass  # the next reader gets what is available
            except (UsageError, OSError) as err:
                self._keep(track.name, Overview(Blocks(), failed=str(err)))
            finally:
                with self._lock:
                    self._busy.discard(track.name)

    def _make(self, track: Track) -> None:
        found = self.of(track)
        if found is not None and (found.complete or found.failed):
            return
        if track.growing:
            self._extend(track, found)
        elif found is None:
            blocks = self._fill(track)
            if track.length >= _KEPT_FROM:
                with suppress(UsageError, OSError):  # disk error: it stays in memory
                    self._cache.store(track.name, blocks.read(0, blocks.rows))
                    if self._cache.find(track.name) is not None:
                        self._forget(track)  # from now on mapped

    def _fill(self, track: Track) -> Blocks:
        """Compute an overview from start to end; it can be read meanwhile."""
        blocks = Blocks()
        overview = self._keep(track.name, Overview(blocks))
        samples = 0
        try:
            for stretch in track.stretches:
                for time_s, values in stretch.strides(0, stretch.length):
                    if self._stop.is_set():
                        raise _StoppedError
                    blocks.append(blocks_of(time_s, values))
                    samples += len(values)
                    overview.reached(blocks.rows, samples)
        except BaseException:
            self._forget(track)
            raise
        overview.reached(blocks.rows, samples, complete=True)
        return blocks

    def _extend(self, track: Track, found: Overview | None) -> None:
        """Extend the overview of a growing track by its complete blocks."""
        overview = found or self._keep(track.name, Overview(Blocks()))
        for stretch in track.stretches:  # a step that is being written has only one
            for time_s, values in stretch.strides(overview.samples, stretch.settled // BLOCK * BLOCK):
                if self._stop.is_set():
                    raise _StoppedError
                overview.blocks.append(blocks_of(time_s, values))
                overview.reached(overview.blocks.rows, overview.samples + len(values))

    def _forget(self, track: Track) -> None:
        with self._lock:
            self._known.pop(track.name, None)

    def _keep(self, name: str, overview: Overview) -> Overview:
        """Store an overview, and remove the least recently used ones above the memory limit."""
        with self._lock:
            self._known[name] = overview
            self._known.move_to_end(name)
            size = sum(one.nbytes for one in self._known.values())
            while size > _MOST_MEMORY and len(self._known) > 1:
                _, oldest = self._known.popitem(last=False)
                size -= oldest.nbytes
        return overview
