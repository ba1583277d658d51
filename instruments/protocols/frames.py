"""Frames of fixed length in an arbitrary stream of bytes: found by their header, accepted if the CRC agrees.

    | header | contents | CRC-32/MPEG-2, 4 | tail |

Every position of a header is tried, so a header inside a frame or in junk costs no valid frame. A frame with a wrong
CRC is never accepted; random bytes pass with a probability of one in four thousand million. If two valid frames
overlap, the first is accepted. The result does not depend on how the bytes were cut into pieces.

Accepted input: junk before, between and after frames, frames truncated or joined, flipped bits, headers in the
contents. Memory: the longest frame, in addition to the piece that is being read.

CRC-32/MPEG-2 is the check of KVH's and Sensonor's frames, computed for one frame or for many at once:

    polynomial 04C11DB7h | register preset to FFFFFFFFh | bits in the order of the wire | result not inverted

Source: the catalogue of parametrised CRC algorithms (check value 0376E6E7h for "123456789"); ROS driver KVH1750Test.cpp
(a frame with its CRC).

One frame: zlib's CRC-32 has the same polynomial with the bits of every byte mirrored and the result inverted, so input
bytes and result are mirrored. Many frames: a CRC is linear, so the contribution of each byte depends on its value and
on the number of bytes that follow, and the CRC of a frame is the exclusive or of one table entry per byte.

Frames carry numbers that wrap; `SequenceNumbers` converts them to an index that does not. A number increases by `step`
from frame to frame and wraps at `modulus`. A loss is a jump, known only modulo `period`: the number of frames after
which the numbers repeat.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from benchctl_instruments.arrays import BoolArray, IntArray

POLYNOMIAL = 0x04C11DB7
PRESET = 0xFFFFFFFF
_BYTE_VALUES = 256

ByteArray = npt.NDArray[np.uint8]
CrcArray = npt.NDArray[np.uint32]

_MIRRORED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def crc32_mpeg2(data: bytes) -> int:
    """Return the CRC of some bytes."""
    mirrored = zlib.crc32(data.translate(_MIRRORED)) ^ PRESET
    return int.from_bytes(mirrored.to_bytes(4, "little").translate(_MIRRORED), "big")


def crc32_mpeg2_of_rows(rows: ByteArray, *, padding: int = 0) -> CrcArray:
    """Return the CRC of each row of shape (n, length), shape (n,), as if `padding` zero bytes followed the row."""
    length = rows.shape[1]
    table, preset_share = _table(length + padding)
    entries = rows + _BYTE_VALUES * np.arange(length)  # a zero byte of padding adds nothing
    crc: CrcArray = np.bitwise_xor.reduce(table[entries], axis=1)
    return crc ^ preset_share


@cache
def _table(length: int) -> tuple[CrcArray, np.uint32]:
    """Return the contribution of each value of each of `length` bytes, shape (length · 256,), and of the preset."""
    last = np.arange(_BYTE_VALUES, dtype=np.uint32) << 24
    for _ in range(8):
        last = (last << 1) ^ (last >> 31) * np.uint32(POLYNOMIAL)
    places = [last]
    for _ in range(length - 1):
        after = places[-1]
        places.append((after << 8) ^ last[after >> 24])
    return np.concatenate(places[::-1]), np.uint32(crc32_mpeg2(bytes(length)))


CRC_BYTES = 4
START, END, KIND = 0, 1, 2  # columns of valid frames; kind is the index of the format in the reader's formats
_LARGEST_PIECE = 1 << 15  # of the data searched at once; more would exceed the processor's cache


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFormat:
    """One kind of frame: the CRC is at `crc_at` and covers the bytes before it, plus `padding` zero bytes not sent."""

    name: str
    header: bytes
    crc_at: int
    padding: int = 0
    tail: bytes = b""

    @property
    def length(self) -> int:
        """Number of bytes of a complete frame on the wire."""
        return self.crc_at + CRC_BYTES + len(self.tail)

    def passes(self, rows: ByteArray) -> BoolArray:
        """Return which rows of shape (n, length) are valid frames, shape (n,)."""
        crc = crc32_mpeg2_of_rows(rows[:, : self.crc_at], padding=self.padding)
        stated = np.ascontiguousarray(rows[:, self.crc_at : self.crc_at + CRC_BYTES]).view(">u4")[:, 0]
        tails = (rows[:, self.crc_at + CRC_BYTES :] == list(self.tail)).all(axis=1)
        passing: BoolArray = (crc == stated) & tails
        return passing

    def sealed(self, contents: ByteArray) -> bytes:
        """Return consecutive frames with CRC and tail for rows of shape (n, crc_at), which include the header."""
        crc = crc32_mpeg2_of_rows(contents, padding=self.padding).astype(">u4").view(np.uint8).reshape(-1, CRC_BYTES)
        tails = np.tile(np.frombuffer(self.tail, np.uint8), (len(contents), 1))
        return np.concatenate((contents, crc, tails), axis=1).tobytes()


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRun:
    """Frames of one format in order: `rows` of shape (n, length).

    `first_byte` counts bytes from the start of the stream, shape (n,): if the distance of two frames exceeds their
    length, the bytes between them were no valid frame.
    """

    format: FrameFormat
    rows: ByteArray
    first_byte: IntArray


class FrameReader:
    """Extract frames from the bytes of one stream.

    Parameters
    ----------
    formats
        The expected formats.

    Attributes
    ----------
    kept
        Number of valid frames.
    bad_frames
        Number of invalid frames that began with a header outside valid frames; junk may contain a header by chance.
    junk_bytes
        Number of bytes that belonged to no valid frame, including those of bad frames. The bytes of valid frames, these
        and those of `waiting` are all bytes received.
    """

    def __init__(self, formats: Sequence[FrameFormat]) -> None:
        self.kept = 0
        self.bad_frames = 0
        self.junk_bytes = 0
        self._formats = tuple(formats)
        self._longest = max(kind.length for kind in formats)
        self._bytes: ByteArray = np.empty(0, np.uint8)
        self._position = 0  # of the first waiting byte, counted from the start of the stream
        self._bad_until = 0  # end of the latest bad frame, in which no other one begins
        self._kept_at_bad = -1  # valid unless a good frame was received since

    @property
    def waiting(self) -> int:
        """Number of bytes that may still become part of a frame; fewer than the longest frame has."""
        return self._bytes.size

    def feed(self, data: bytes) -> list[FrameRun]:
        """Add received bytes and return the frames that they complete."""
        runs: list[FrameRun] = []
        for first in range(0, len(data), _LARGEST_PIECE):
            piece = np.frombuffer(data, np.uint8, min(_LARGEST_PIECE, len(data) - first), first)
            self._bytes = np.concatenate((self._bytes, piece))
            runs += self._read()
        return runs

    def _read(self) -> list[FrameRun]:
        """Return the complete frames, and discard all bytes that are decided."""
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
        """Count failed headers outside valid frames, except those within the span of a counted one."""
        kept_before = self.kept + np.searchsorted(good[:, START], failed)
        for start, kept in zip((failed + self._position).tolist(), kept_before.tolist(), strict=True):
            if start >= self._bad_until or kept != self._kept_at_bad:
                self.bad_frames += 1
                self._bad_until = start + self._longest
                self._kept_at_bad = kept


@dataclass(frozen=True, slots=True)
class _Found:
    """Where a format's headers begin valid frames, shape (n, 3), failed ones, and incomplete ones."""

    good: IntArray
    failed: IntArray
    unfinished: IntArray


def _search(buffer: ByteArray, kind: FrameFormat, index: int) -> _Found:
    starts = _header_starts(buffer, kind.header)
    complete = starts[starts + kind.length <= buffer.size]
    passes = kind.passes(_rows(buffer, complete, kind.length))
    good = complete[passes]
    return _Found(
        good=np.stack((good, good + kind.length, np.full_like(good, index)), axis=1),
        failed=complete[~passes],
        unfinished=starts[complete.size :],
    )


def _header_starts(buffer: ByteArray, header: bytes) -> IntArray:
    """Return where the header begins, in increasing order; at the end of the buffer a part of it is sufficient."""
    starts = np.flatnonzero(buffer == header[0])
    for place, byte in enumerate(header[1:], 1):
        beyond = starts + place >= buffer.size
        starts = starts[beyond | (buffer[np.minimum(starts + place, buffer.size - 1)] == byte)]
    return starts


def _rows(buffer: ByteArray, starts: IntArray, length: int) -> ByteArray:
    """Return segments of a buffer, shape (n, length)."""
    if not starts.size:
        return np.empty((0, length), np.uint8)
    rows: ByteArray = np.lib.stride_tricks.sliding_window_view(buffer, length)[starts]
    return rows


def _first_of_overlapping(good: IntArray) -> IntArray:
    """Return frames ordered by their starts, without those that begin inside an accepted one."""
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
    """Return which places are inside valid frames, shape (n,)."""
    before = np.searchsorted(good[:, START], places, side="right") - 1
    ends = np.append(good[:, END], 0)  # without a previous frame: the last entry, 0
    inside: BoolArray = places < ends[before]
    return inside


class SequenceNumbers:
    """Compute the index of each frame of one stream; the first one is 0, and missing frames are counted.

    Parameters
    ----------
    modulus
        The number of different sequence numbers.
    step
        The increment of the number from one frame to the next.

    Attributes
    ----------
    lost
        Number of missing frames so far.
    """

    def __init__(self, modulus: int, *, step: int = 1) -> None:
        common = math.gcd(step, modulus)
        self.period = modulus // common
        self.lost = 0
        self._modulus = modulus
        self._common = common
        self._frames_per_unit = pow(step // common, -1, self.period) if self.period > 1 else 0
        self._last: int | None = None
        self._next_index = 0

    def unwrap(self, numbers: npt.NDArray[np.integer]) -> tuple[IntArray, IntArray]:
        """Return the index of each frame and the number of missing frames just before it, both of shape (n,).

        An impossible number is replaced by the nearest possible one below it.
        """
        if not numbers.size:
            return np.empty(0, np.int64), np.empty(0, np.int64)
        present: IntArray = numbers.astype(np.int64)
        jumps: IntArray = np.diff(present, prepend=present[0] if self._last is None else self._last) % self._modulus
        frames = jumps // self._common * self._frames_per_unit % self.period
        missing = (frames - 1) % self.period
        if self._last is None:
            missing[0] = 0
        index: IntArray = self._next_index + np.cumsum(missing) + np.arange(numbers.size)
        self.lost += int(missing.sum())
        self._last, self._next_index = int(present[-1]), int(index[-1]) + 1
        return index, missing


def commonest_step(numbers: npt.NDArray[np.integer], modulus: int) -> int:
    """Return the most frequent increment of the numbers of consecutive frames, shape (n,), n ≥ 2."""
    present: IntArray = numbers.astype(np.int64)
    return int(np.argmax(np.bincount((present[1:] - present[:-1]) % modulus)))
