"""The common part of the drivers of gyros that send frames spontaneously.

| hook                | default    | a gyro's driver overrides it to                                                  |
|---------------------|------------|----------------------------------------------------------------------------------|
| `_check()`          | (required) | check after connecting that the right gyro answers, and store its identity       |
| `_begin(rate_hz)`   | (required) | start the frames; return the rate, a queue, and the stream's bytes so far        |
| `_end()`            | no action  | stop the frames                                                                  |

Fault handling: a frame that is lost, truncated, corrupted or split by junk is a gap at its position, reported with the
block; junk between frames is ignored; both are counted. A silent line raises `LinkError` with the number of samples
received, which are kept. A sample that the gyro marks as doubtful is reported in `valid` and `faults`.

`SampleQueue` holds the received samples until they are taken: it takes bytes and returns blocks.
"""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, TypeVar

import numpy as np

from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.errors import BenchError, LinkError, UsageError
from benchctl_instruments.interfaces import Clock, GyroBlock, GyroCounts, GyroGap, Identity, Instrument
from benchctl_instruments.links.serial_port import byte_link
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.mounting import AXES
from benchctl_instruments.protocols.frames import ByteArray, FrameFormat, FrameReader, FrameRun, SequenceNumbers


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """Decoded frames; arrays as in `GyroBlock`. `number` is the frame's own, which wraps."""

    number: IntArray
    rate_dps: FloatArray
    rates_dps: FloatArray
    temperature_c: FloatArray
    status: IntArray
    valid: BoolArray


class SampleQueue:
    """Extract samples from the bytes of a stream.

    Parameters
    ----------
    format
        The frame that carries a sample.
    numbers
        The numbering of the frames.
    decode
        Converts rows of shape (n, length) to samples.
    words
        Converts a status that is not valid to texts.
    rate_hz
        Frames per second.
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
        self._wrap_s = (numbers.period - 1) / rate_hz  # during a shorter time all lost frames are counted
        self._runs: list[tuple[FrameRun, float]] = []
        self._taken = 0
        self._end = 0  # end of the last frame taken, in bytes from the start of the stream

    @property
    def waiting(self) -> int:
        """Number of available samples."""
        return self._reader.kept - self._taken

    @property
    def junk_bytes(self) -> int:
        """Number of bytes that belonged to no valid frame."""
        return self._reader.junk_bytes

    def feed(self, data: bytes, *, unheard_s: float) -> None:
        """Add received bytes; `unheard_s` is how long the line may have been unread just before or within them."""
        self._runs += [(run, unheard_s) for run in self._reader.feed(data)]

    def take(self) -> GyroBlock:
        """Return all available samples; the queue must not be empty."""
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
            rates_dps=samples.rates_dps,
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
        """Return where samples are missing; bytes that form no frame may hide a complete wrap of the numbers."""
        places = np.flatnonzero((missing > 0) | (torn & deaf))
        return tuple(
            GyroGap(index=place, lost=int(missing[place]), exact=not bool(deaf[place])) for place in places.tolist()
        )


LARGEST_RECEIVE = 1 << 16
WIRE_LATENCY_S = 0.02
"""Largest delay of a byte; serial converters on USB keep bytes for up to 16 ms."""

Answer = TypeVar("Answer")


class FramedGyro(Instrument, ABC):
    """Driver of a gyro on a serial line; implements `benchctl_instruments.interfaces.Gyro`.

    Times are the gyro's own: the number of a sample divided by the rate. The clock is only used to find whether the
    line was unread for so long that the numbers may have wrapped.

    Parameters
    ----------
    address
        `serial://DEVICE?baud=N`, by default at `DEFAULT_BAUD`, or `socket://HOST:PORT` behind a serial-to-Ethernet box.
    clock
        The clock that measures how long the line was unread.
    axis
        "x", "y" or "z", otherwise raises `UsageError`: the one whose samples are reported; the others' are reported
        beside it.
    timeout_s
        Timeout of an answer and of a connection; wall time.
    wire_log
        Log of the traffic on the line.

    Attributes
    ----------
    NAME
        The model, for messages.
    RATES_HZ
        The rates that this model supports; empty: any.
    """

    NAME: ClassVar[str]
    DEFAULT_BAUD: ClassVar[int]
    RATES_HZ: tuple[float, ...] = ()

    def __init__(
        self, address: str, *, clock: Clock, axis: str = "z", timeout_s: float = 2.0, wire_log: WireLog | None = None
    ) -> None:
        if axis not in AXES:
            raise UsageError(f"axis {axis!r}: expected x, y or z, which a {self.NAME} has")
        self._axis = AXES.index(axis)
        self._link = byte_link(address, default_baud=self.DEFAULT_BAUD, wire_log=wire_log)
        self._who = f"{self.NAME} at {self._link.address}"
        self._clock = clock
        self._timeout_s = timeout_s
        self._identity = Identity()
        self._queue: SampleQueue | None = None  # while a stream runs
        self._all_read_s = 0.0  # by the clock: everything that had arrived until then was read

    def open(self) -> None:
        """Connect and check that the right gyro answers."""
        self._link.open(self._timeout_s)
        try:
            self._check()
        except BenchError:
            self._link.close()
            raise

    def close(self) -> None:
        """Close the link; safe to call twice, and never raises."""
        self._queue = None
        self._link.close()

    def identify(self) -> Identity:
        """Return the identity that the gyro reported when it was opened."""
        return self._identity

    def start_stream(self, rate_hz: float) -> float:
        """Start the stream and return its actual rate [Hz]."""
        if self._queue is not None:
            raise UsageError(f"{self._who}: start_stream while the stream runs; call stop_stream first")
        if not 0.0 < rate_hz < math.inf:
            raise UsageError(f"{self._who}: a rate of {rate_hz} samples a second; give a finite one above 0")
        actual_hz, queue, come = self._begin(rate_hz)
        self._all_read_s = self._clock.now()
        queue.feed(come, unheard_s=0.0)
        self._queue = queue
        return actual_hz

    def read_stream(self, samples: int, timeout_s: float) -> GyroBlock:
        """Return at least `samples` samples and any others received; see `benchctl_instruments.interfaces.Gyro`."""
        if self._queue is None:
            raise UsageError(f"{self._who}: read_stream while no stream runs; call start_stream first")
        wanted = max(samples, 1)
        give_up_s = time.monotonic() + timeout_s
        try:
            while self._queue.waiting < wanted:
                self._receive(self._queue, give_up_s)
        except LinkError as err:
            raise LinkError(
                f"{self._who}: expected {wanted} samples within {timeout_s:g} s, {self._queue.waiting} came; in this"
                f" stream {self._queue.junk_bytes} bytes were no sample: {self._link.address.left_out(err)};"
                " check its supply, its line and its baud"
            ) from err
        return self._queue.take()

    def stop_stream(self) -> None:
        """Stop the stream and discard unread samples. Safe to call if no stream runs."""
        self._queue = None
        self._end()

    @abstractmethod
    def _check(self) -> None: ...

    @abstractmethod
    def _begin(self, rate_hz: float) -> tuple[float, SampleQueue, bytes]: ...

    def _end(self) -> None:
        return

    def _ask(self, question: bytes, answer: Callable[[bytes], Answer | None], expected: str) -> Answer:
        """Send a question and listen until `answer` finds the answer in all bytes received so far."""
        give_up_s = time.monotonic() + self._timeout_s
        self._link.send(question)
        heard = b""
        while (found := answer(heard)) is None:
            try:
                heard += self._link.receive(LARGEST_RECEIVE, self._left_s(give_up_s))
            except LinkError as err:
                raise LinkError(
                    f"{self._who}: sent {question!r}, expected {expected} within {self._timeout_s:g} s, got"
                    f" {len(heard)} bytes without it: {self._link.address.left_out(err)}; check the line to the gyro"
                    " and its baud"
                ) from err
        return found

    def _receive(self, queue: SampleQueue, give_up_s: float) -> None:
        """Read the available bytes into the queue."""
        looked_s = self._clock.now()
        data = self._link.receive(LARGEST_RECEIVE, self._left_s(give_up_s))
        queue.feed(data, unheard_s=self._clock.now() - self._all_read_s + WIRE_LATENCY_S)
        if len(data) < LARGEST_RECEIVE:
            self._all_read_s = looked_s

    def _left_s(self, give_up_s: float) -> float:
        left_s = give_up_s - time.monotonic()
        if left_s <= 0.0:
            raise LinkError("the time is over")
        return left_s
