"""The samples of one gyro's stream that have come and were not taken yet: bytes in, blocks out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.interfaces import GyroBlock, GyroCounts, GyroGap
from benchctl_instruments.protocols.crc32_mpeg2 import ByteArray
from benchctl_instruments.protocols.frames import FrameFormat, FrameReader, FrameRun
from benchctl_instruments.protocols.sequence_numbers import SequenceNumbers


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """What frames say, every array of shape (n,): `number` is the frame's own, which wraps; see `GyroBlock`."""

    number: IntArray
    rate_dps: FloatArray
    temperature_c: FloatArray
    status: IntArray
    valid: BoolArray


class SampleQueue:
    """Samples out of the bytes of a stream.

    Parameters
    ----------
    format
        The frame that carries a sample.
    numbers
        How frames are numbered.
    decode
        From rows of shape (n, length) to samples.
    words
        What a status that is not valid says.
    rate_hz
        Frames a second.
    """

    def __init__(
        self,
        format: FrameFormat,
        numbers: SequenceNumbers,
        *,
        decode: Callable[[ByteArray], Samples],
        words: Callable[[int], tuple[str, ...]],
        rate_hz: float,
    ) -> None:
        self._reader = FrameReader([format])
        self._numbers = numbers
        self._decode = decode
        self._words = words
        self._wrap_s = (numbers.period - 1) / rate_hz  # frames that were lost in less are all counted
        self._runs: list[tuple[FrameRun, float]] = []
        self._taken = 0
        self._end = 0  # of the frame that was taken last, in bytes from the start of the stream

    @property
    def waiting(self) -> int:
        """How many samples wait."""
        return self._reader.kept - self._taken

    @property
    def junk_bytes(self) -> int:
        """How many bytes belonged to no good frame."""
        return self._reader.junk_bytes

    def feed(self, data: bytes, *, unheard_s: float) -> None:
        """Take bytes as they come; `unheard_s` is how long the line may have been deaf just before or within them."""
        self._runs += [(run, unheard_s) for run in self._reader.feed(data)]

    def take(self) -> GyroBlock:
        """All samples that wait; there must be some."""
        runs, self._runs = self._runs, []
        first_byte = np.concatenate([run.first_byte for run, _ in runs])
        unheard_s = np.repeat([unheard_s for _, unheard_s in runs], [len(run.rows) for run, _ in runs])
        rows = np.concatenate([run.rows for run, _ in runs])
        samples = self._decode(rows)
        sequence, missing = self._numbers.unwrap(samples.number)
        torn = first_byte != np.append(self._end if self._taken else first_byte[0], first_byte[:-1] + rows.shape[1])
        self._taken += len(rows)
        self._end = int(first_byte[-1]) + rows.shape[1]
        return GyroBlock(
            sequence=sequence,
            rate_dps=samples.rate_dps,
            temperature_c=samples.temperature_c,
            status=samples.status,
            valid=samples.valid,
            faults=self._faults(samples),
            gaps=self._gaps(missing, torn, unheard_s >= self._wrap_s),
            counts=GyroCounts(
                samples=self._taken,
                lost=self._numbers.lost,
                bad_frames=self._reader.bad_frames,
                junk_bytes=self._reader.junk_bytes,
            ),
            wrap=self._numbers.period,
        )

    def _faults(self, samples: Samples) -> tuple[str, ...]:
        stated = np.unique(samples.status[~samples.valid]).tolist()
        return tuple(sorted({words for status in stated for words in self._words(status)}))

    def _gaps(self, missing: IntArray, torn: BoolArray, deaf: BoolArray) -> tuple[GyroGap, ...]:
        """Where samples are missing; bytes that make no frame may hide a whole wrap of them."""
        places = np.flatnonzero((missing > 0) | (torn & deaf))
        return tuple(
            GyroGap(index=place, lost=int(missing[place]), exact=not bool(deaf[place])) for place in places.tolist()
        )
