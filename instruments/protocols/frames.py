"""Frames of fixed length in a stream of bytes that may hold anything: found by header, taken where the CRC agrees.

    | header | contents | CRC-32/MPEG-2, 4 | tail |     contents and CRC: `benchctl_instruments.protocols.crc32_mpeg2`

Every place where a header stands is tried, so a header inside a frame or in junk costs no good frame. What fails its
CRC is never taken; of what is no frame at all, one in four thousand million passes. Where two frames that pass overlap,
the first is taken. What was read does not depend on how the bytes were cut into pieces.

Survived: junk before, between and after frames, frames cut short or joined, flipped bits, headers in the contents.
Memory: the longest frame, beside the piece that is being read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchctl_instruments.arrays import BoolArray, IntArray
from benchctl_instruments.protocols.crc32_mpeg2 import ByteArray, crc32_mpeg2_of_rows

CRC_BYTES = 4
START, END, KIND = 0, 1, 2  # columns of good frames; kind is the place of the format among the reader's
_LARGEST_PIECE = 1 << 15  # of what is searched at once; more would leave the processor's cache


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFormat:
    """One kind of frame: the CRC stands at `crc_at` and covers what is before it, and `padding` zero bytes unsent."""

    name: str
    header: bytes
    crc_at: int
    padding: int = 0
    tail: bytes = b""

    @property
    def length(self) -> int:
        """Bytes of a whole frame on the wire."""
        return self.crc_at + CRC_BYTES + len(self.tail)

    def passes(self, rows: ByteArray) -> BoolArray:
        """Which rows of shape (n, length) are whole frames, shape (n,)."""
        crc = crc32_mpeg2_of_rows(rows[:, : self.crc_at], padding=self.padding)
        stated = np.ascontiguousarray(rows[:, self.crc_at : self.crc_at + CRC_BYTES]).view(">u4")[:, 0]
        tails = (rows[:, self.crc_at + CRC_BYTES :] == list(self.tail)).all(axis=1)
        passing: BoolArray = (crc == stated) & tails
        return passing

    def sealed(self, contents: ByteArray) -> bytes:
        """Frames from rows of shape (n, crc_at), header included: with CRC and tail, one after the other."""
        crc = crc32_mpeg2_of_rows(contents, padding=self.padding).astype(">u4").view(np.uint8).reshape(-1, CRC_BYTES)
        tails = np.tile(np.frombuffer(self.tail, np.uint8), (len(contents), 1))
        return np.concatenate((contents, crc, tails), axis=1).tobytes()


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRun:
    """Frames of one format in their order: `rows` of shape (n, length).

    `first_byte` counts bytes from the start of the stream, shape (n,): where two frames stand further apart than their
    length, what lay between them was no good frame.
    """

    format: FrameFormat
    rows: ByteArray
    first_byte: IntArray


class FrameReader:
    """Frames out of the bytes of one stream.

    Parameters
    ----------
    formats
        What may come.

    Attributes
    ----------
    kept
        How many good frames there were.
    bad_frames
        How many headers outside good frames began one that failed; in junk a header may stand by chance.
    junk_bytes
        How many bytes belonged to no good frame, those of bad frames included. The bytes of good frames, these and
        those of `waiting` are all that ever came.
    """

    def __init__(self, formats: Sequence[FrameFormat]) -> None:
        self.kept = 0
        self.bad_frames = 0
        self.junk_bytes = 0
        self._formats = tuple(formats)
        self._longest = max(kind.length for kind in formats)
        self._bytes: ByteArray = np.empty(0, np.uint8)
        self._position = 0  # of the first byte that waits, counted from the start of the stream
        self._bad_until = 0  # the span of the latest bad frame, in which no other one begins
        self._kept_at_bad = -1  # unless a good frame has come since

    @property
    def waiting(self) -> int:
        """How many bytes may still become part of a frame; fewer than the longest frame has."""
        return self._bytes.size

    def feed(self, data: bytes) -> list[FrameRun]:
        """Take bytes as they come; the frames that are complete with them."""
        runs: list[FrameRun] = []
        for first in range(0, len(data), _LARGEST_PIECE):
            piece = np.frombuffer(data, np.uint8, min(_LARGEST_PIECE, len(data) - first), first)
            self._bytes = np.concatenate((self._bytes, piece))
            runs += self._read()
        return runs

    def _read(self) -> list[FrameRun]:
        """Take the frames that wait, and let go of all bytes whose fate is known."""
        found = [_search(self._bytes, kind, index) for index, kind in enumerate(self._formats)]
        good = _first_of_overlapping(np.concatenate([part.good for part in found]))
        failed, unfinished = (
            np.sort(np.concatenate(starts))
            for starts in zip(*((part.failed, part.unfinished) for part in found), strict=True)
        )
        open_ends = unfinished[~_inside(good, unfinished)]
        decided = int(open_ends[0]) if open_ends.size else self._bytes.size
        good = good[good[:, START] < decided]
        self._count_bad(good, failed[(failed < decided) & ~_inside(good, failed)])
        self.kept += len(good)
        self.junk_bytes += decided - int((good[:, END] - good[:, START]).sum())
        runs = [self._run(part) for part in np.split(good, np.flatnonzero(np.diff(good[:, KIND])) + 1) if len(part)]
        self._bytes = self._bytes[decided:].copy()
        self._position += decided
        return runs

    def _run(self, good: IntArray) -> FrameRun:
        kind, starts = self._formats[good[0, KIND]], good[:, START]
        return FrameRun(format=kind, rows=_rows(self._bytes, starts, kind.length), first_byte=starts + self._position)

    def _count_bad(self, good: IntArray, failed: IntArray) -> None:
        """Count headers that failed outside good frames, those inside the span of a counted one left out."""
        kept_before = self.kept + np.searchsorted(good[:, START], failed)
        for start, kept in zip((failed + self._position).tolist(), kept_before.tolist(), strict=True):
            if start >= self._bad_until or kept != self._kept_at_bad:
                self.bad_frames += 1
                self._bad_until = start + self._longest
                self._kept_at_bad = kept


@dataclass(frozen=True, slots=True)
class _Found:
    """Where a format's header has led to good frames, shape (n, 3), to failed ones, and to what is not yet whole."""

    good: IntArray
    failed: IntArray
    unfinished: IntArray


def _search(buffer: ByteArray, kind: FrameFormat, index: int) -> _Found:
    starts = _header_starts(buffer, kind.header)
    whole = starts[starts + kind.length <= buffer.size]
    passes = kind.passes(_rows(buffer, whole, kind.length))
    good = whole[passes]
    return _Found(
        good=np.stack((good, good + kind.length, np.full_like(good, index)), axis=1),
        failed=whole[~passes],
        unfinished=starts[whole.size :],
    )


def _header_starts(buffer: ByteArray, header: bytes) -> IntArray:
    """Where the header stands, or at the end its beginning, as far as the bytes go; increasing."""
    starts = np.flatnonzero(buffer == header[0])
    for place, byte in enumerate(header[1:], 1):
        beyond = starts + place >= buffer.size
        starts = starts[beyond | (buffer[np.minimum(starts + place, buffer.size - 1)] == byte)]
    return starts


def _rows(buffer: ByteArray, starts: IntArray, length: int) -> ByteArray:
    """Stretches of a buffer, shape (n, length)."""
    if not starts.size:
        return np.empty((0, length), np.uint8)
    rows: ByteArray = np.lib.stride_tricks.sliding_window_view(buffer, length)[starts]
    return rows


def _first_of_overlapping(good: IntArray) -> IntArray:
    """Frames in the order of their starts, without those that begin inside of one that was taken."""
    good = good[np.lexsort((good[:, KIND], good[:, START]))]
    if (good[1:, START] >= good[:-1, END]).all():
        return good
    taken, until = [], 0
    for place, (start, end, _) in enumerate(good.tolist()):
        if start >= until:
            taken.append(place)
            until = end
    return good[taken]


def _inside(good: IntArray, places: IntArray) -> BoolArray:
    """Which places are inside of good frames, shape (n,)."""
    before = np.searchsorted(good[:, START], places, side="right") - 1
    ends = np.append(good[:, END], 0)  # no frame before: the last entry, 0
    inside: BoolArray = places < ends[before]
    return inside
