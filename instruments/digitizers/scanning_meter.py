"""What the drivers of scanning multimeters have in common: a multimeter behind a multiplexer, commanded by SCPI.

Such an instrument measures the gyro's volts and its thermistor one after the other, a few times a second, with an
integrating converter, and stores the readings; the driver fetches them. The instrument's own timer starts each scan, so
that scans are equidistant. The gyro's reading and that of the thermistor belong to one scan but not to one instant:
this suits rests and constant rates. `FASTEST_HZ` is the highest scan rate at which a reading still averages over a
whole period of 50 Hz mains; the driver uses the longest average, of 1, 2 or 10 periods, that fits between two scans.

There is no input for an encoder: `counts_encoder` is False, and every count is 0. `table_angle.TableAngleDigitizer`
supplies the angle from the rate table.

The thermistor's channel measures the volts of an amplifier, or itself a temperature in °C, see `TEMPERATURES`; then
`thermistor_v` of a scan is that number, which `thermistor_c_per_v = 1` and `thermistor_c_at_0v = 0` of bench.toml
leave unchanged.

| fault                                           | handling                                                        |
|-------------------------------------------------|-----------------------------------------------------------------|
| no answer, a late one, a cut link               | repeated once on a new connection, as in `links.lines`          |
| an unreadable answer                            | repeated once; readings that are deleted are then a gap         |
| a command that it refuses                       | `InstrumentError`: the queue of errors is read after each       |
| a scan runs that this driver did not start      | `InstrumentError`: it belongs to another program                |
| an answer with readings is lost                 | a gap, if the instrument has deleted them: readings carry times |
| no readings arrive, its memory is full          | `LinkError`                                                     |
| a reading outside the range                     | `InstrumentError`                                               |
| readings that are stuck                         | not handled                                                     |
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import partial
from typing import ClassVar, TypeVar

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import BenchError, InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Clock, Identity, Instrument, ScanBlock, SingleScan, StreamStart
from benchctl_instruments.links.lines import LineDialogue, Manners
from benchctl_instruments.links.serial_port import byte_link
from benchctl_instruments.links.tcp import Reconnect
from benchctl_instruments.links.wirelog import WireLog, note_recovered
from benchctl_instruments.protocols import scpi
from benchctl_instruments.protocols.lines import MOST_SHOWN, UnreadableError, parse_number
from benchctl_instruments.recognition import ByLine

Answer = TypeVar("Answer")

BAUD = 9600
VOLTS = "volts"
LINE_CYCLES = (10, 2, 1)
MAINS_HZ = 50.0
SHARE = 0.9  # of the time between two scans that the readings of one scan may take
MOST_SCANS = 50
"""Scans in one answer: about 2 kB."""
CHANNELS = 2
VALUES = 2 * CHANNELS  # a reading and its time, of each channel
STOP_S = 2.0
LEAST_OVERLOAD = 0.99 * scpi.OVERLOAD


def recognition_of(model: str, query: str) -> tuple[ByLine, ...]:
    """Return how a model is recognised: by its name; `query` is not needed for it."""

    def read(answer: str) -> str:
        raise InstrumentError(f"expected the name {model}, got {answer[:MOST_SHOWN]!r}")

    return (ByLine(query=query, read=read, names=(model,), sent_end=b"\n", baud=BAUD),)


class ScanningMeter(Instrument, ABC):
    """A scanning multimeter; implements `interfaces.Digitizer` without an encoder. Not tried on hardware.

    Parameters
    ----------
    address
        `tcp://HOST:5025`, `serial://DEVICE?baud=N`, `socket://HOST:PORT` or `visa://GPIB0::9::INSTR`.
    clock
        The clock of `StreamStart.start_s`; the instrument itself has no counter that runs on between two streams.
    gyro_channel, thermistor_channel
        The channels of the multiplexer, such as 101.
    temperature
        What the thermistor's channel measures: "volts", or a key of `TEMPERATURES`.
    range_v
        Range of the voltages, one of `RANGES_V`.
    timeout_s
        Timeout of a connection and of an answer, wall time; a single scan takes up to 1 s.
    reconnect, wire_log
        See `byte_link`.
    """

    counts_encoder: ClassVar[bool] = False
    FASTEST_HZ: ClassVar[float]
    NAME: ClassVar[str]
    MODEL: ClassVar[str]
    """Part of the answer to `*IDN?`."""
    RANGES_V: ClassVar[tuple[float, ...]]
    SWITCH_S: ClassVar[float]
    """Time that the multiplexer needs for a channel."""
    TEMPERATURES: ClassVar[Mapping[str, str]]
    """Name of a sensor: the arguments that select it."""

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        gyro_channel: int = 101,
        thermistor_channel: int = 102,
        temperature: str = VOLTS,
        range_v: float = 10.0,
        timeout_s: float = 5.0,
        reconnect: Reconnect | None = None,
        wire_log: WireLog | None = None,
    ) -> None:
        if gyro_channel == thermistor_channel:
            raise UsageError(f"gyro_channel and thermistor_channel are both {gyro_channel}: expected two channels")
        if temperature != VOLTS and temperature not in self.TEMPERATURES:
            raise UsageError(f"temperature = {temperature!r}: expected one of {', '.join((VOLTS, *self.TEMPERATURES))}")
        if range_v not in self.RANGES_V:
            raise UsageError(f"range_v {range_v:g}: expected one of the ranges of a {self.NAME}, {self.RANGES_V} V")
        self._lines = LineDialogue(
            self.NAME,
            byte_link(address, default_baud=BAUD, reconnect=reconnect, wire_log=wire_log),
            manners=Manners(sent_end=b"\n", timeout_s=timeout_s, commands_answered=False),
            clock=clock,
        )
        self._who, self._clock, self._range_v, self._temperature = self._lines.who, clock, range_v, temperature
        self._gyro, self._thermistor = gyro_channel, thermistor_channel
        self._channels = tuple(sorted((gyro_channel, thermistor_channel)))  # the order in which both makers scan them
        self._opened_s = 0.0
        self._interval_s: float | None = None  # while a stream runs
        self._fetched = self._next_index = 0
        self._first_s = 0.0  # time stamp of the stream's first reading
        self._received = np.empty((0, 1 + CHANNELS))  # scan number, gyro and thermistor of scans not yet returned
        self._is_set_up = False

    def open(self) -> None:
        """Connect and check that the right instrument answers; it is set up when it is first used."""
        self._lines.open()
        try:
            if self.MODEL not in (answer := self._lines.ask(scpi.IDENTITY)).upper():
                raise InstrumentError(
                    f"{self._who}: asked {scpi.IDENTITY}, expected a {self.MODEL}, got {answer[:MOST_SHOWN]!r};"
                    " check address and model"
                )
        except BenchError:
            self._lines.close()
            raise
        self._opened_s, self._interval_s, self._is_set_up = self._clock.now(), None, False

    def close(self) -> None:
        """Close the link; safe to call twice, and never raises."""
        self._lines.close()
        self._interval_s = None

    def identify(self) -> Identity:
        """Return the identity from `*IDN?` (manufacturer, model, serial, firmware), empty for other answers."""
        words = [word.strip() for word in self._lines.ask(scpi.IDENTITY).split(",")]
        if len(words) != 4:
            return Identity()
        return Identity(manufacturer=words[0], model=words[1], serial=words[2], firmware=words[3])

    def read_once(self) -> SingleScan:
        """Return one scan; the encoder's count is 0."""
        if self._interval_s is not None:
            raise UsageError(f"{self._who}: read_once while the stream runs; call stop_stream first")
        if not self._is_set_up:
            self._set_up(LINE_CYCLES[-1])
        _, gyro_v, thermistor_v = self._read(self._single, lambda answer: self._table(answer, 1)[0])
        return SingleScan(encoder_count=0, gyro_v=float(gyro_v), thermistor_v=float(thermistor_v))

    def start_stream(self, rate_hz: float) -> StreamStart:
        """Start to scan at the nearest rate whose interval is a whole number of milliseconds; return that rate."""
        if self._interval_s is not None:
            raise UsageError(f"{self._who}: start_stream while the stream runs; call stop_stream first")
        if not 0.0 < rate_hz <= self.FASTEST_HZ:
            raise UsageError(
                f"{self._who}: a scan rate of {rate_hz:g} Hz; a {self.NAME} scans at most {self.FASTEST_HZ:g} times a"
                " second: lower sample_rate_hz"
            )
        interval_s = round(1.0 / rate_hz, 3)
        self._set_up(self._line_cycles(interval_s))
        asked_s = self._clock.now()
        self._start(f"{interval_s:.3f}")
        start_s = 0.5 * (asked_s + self._clock.now()) - self._opened_s
        self._interval_s, self._fetched, self._next_index = interval_s, 0, 0
        self._received = self._received[:0]
        return StreamStart(rate_hz=1.0 / interval_s, start_s=start_s)

    def read_stream(self, scans: int, timeout_s: float) -> ScanBlock:
        """Return at least `scans` scans and any others received; see `benchctl_instruments.interfaces.Digitizer`.

        Each encoder count is 0.
        """
        if self._interval_s is None:
            raise UsageError(f"{self._who}: read_stream while no stream runs; call start_stream first")
        wanted, give_up_s = max(scans, 1), time.monotonic() + timeout_s
        while (more := self._receive(self._interval_s)) or len(self._received) < wanted:
            if time.monotonic() > give_up_s:
                raise LinkError(
                    f"{self._who}: expected {wanted} scans within {timeout_s:g} s, {len(self._received)} came; look"
                    " whether it scans"
                )
            if not more:
                self._clock.sleep(self._interval_s)
        steps = np.diff(self._received[:, 0], prepend=self._next_index - 1.0)
        if np.any(steps < 1):
            raise InstrumentError(
                f"{self._who}: expected readings {self._interval_s:g} s apart, the times of two are closer; check that"
                " no other program uses it"
            )
        gaps = np.flatnonzero(steps[1:] > 1) + 1
        end = int(gaps[0]) if gaps.size else len(self._received)
        block, self._received = self._received[:end], self._received[end:]
        self._next_index = int(block[-1, 0]) + 1
        return ScanBlock(
            first_index=int(block[0, 0]),
            encoder_count=np.zeros(end, np.int64),
            gyro_v=block[:, 1],
            thermistor_v=block[:, 2],
            backlog=len(self._received),
        )

    def stop_stream(self) -> None:
        """Stop scanning and discard the stored readings. Safe to call if no stream runs."""
        self._interval_s = None
        self._tell("*CLS;ABOR")  # readings that were asked for twice, and deleted, have left an error
        asked_s = time.monotonic()
        while self._scans():
            if time.monotonic() - asked_s > STOP_S:
                raise InstrumentError(
                    f"{self._who}: commanded to stop its scan, it still scans after {STOP_S:g} s; switch it off and on"
                )

    def _receive(self, interval_s: float) -> bool:
        """Fetch stored scans, as many as fit into an answer; return whether more are stored.

        The first reading of a stream comes less than an interval after its start, as its scan fits into one.
        """
        if (ready := self._ready(self._fetched)) <= 0:
            return False
        few = min(ready, MOST_SCANS)
        try:
            table = self._table(self._fetch(self._fetched, few), few)
        except UnreadableError as err:  # asked for again, or, if the instrument has deleted them, a gap
            note_recovered(f"{self._who}: asked for {few} scans, {err}")
            return True
        if self._fetched == 0:
            self._first_s = table[0, 0] % interval_s
        table[:, 0] = np.round((table[:, 0] - self._first_s) / interval_s)
        self._received = np.concatenate((self._received, table))
        self._fetched += few
        return ready > few

    def _set_up(self, line_cycles: int) -> None:
        if self._scans():
            raise InstrumentError(
                f"{self._who}: a scan runs that this program did not start: another one records with it; wait for its"
                " end, or press its key that stops a scan"
            )
        self._tell("*RST;*CLS")
        for command in self._configuration(line_cycles):
            self._tell(command)
        self._is_set_up = True

    def _line_cycles(self, interval_s: float) -> int:
        """Return the longest average that fits; each reading takes it twice, the second time of the converter's 0 V."""
        most_s = SHARE * interval_s / CHANNELS - self.SWITCH_S
        return next((cycles for cycles in LINE_CYCLES if 2.0 * cycles / MAINS_HZ <= most_s), LINE_CYCLES[-1])

    def _tell(self, command: str) -> None:
        """Send a command and read the queue of errors in one line: it is repeated if the answer is lost."""
        code, says = self._ask(f"{command};:{scpi.NEXT_ERROR}", scpi.parse_error)
        if code:
            raise InstrumentError(
                f"{self._who}: sent {command!r}, it answers {code}, {says!r}; check its model, its card and the options"
            )

    def _table(self, answer: str, scans: int) -> FloatArray:
        """Return time [s], gyro and thermistor reading of each scan, shape (scans, 3); may be unreadable."""
        values = np.array(scpi.parse_numbers(answer, scans * VALUES)).reshape(scans, VALUES)
        columns = [1]
        for name, channel in (("gyro", self._gyro), ("thermistor", self._thermistor)):
            columns.append(2 * self._channels.index(channel))
            if np.any(np.abs(values[:, columns[-1]]) >= LEAST_OVERLOAD):
                raise InstrumentError(
                    f"{self._who}: channel {channel}, the {name}, is outside its range, or open; check the wiring"
                )
        return values[:, columns]

    def _count(self, query: str) -> int:
        return int(self._ask(query, parse_number))

    def _ask(self, query: str, parse: Callable[[str], Answer]) -> Answer:
        return self._read(partial(self._lines.ask, query), parse)

    def _read(self, ask: Callable[[], str], parse: Callable[[str], Answer]) -> Answer:
        """Return the parsed answer. An unreadable answer is requested a second time: lines have no checksum."""
        try:
            return parse(ask())
        except UnreadableError as err:
            garbled = str(err)
        try:
            answer = parse(ask())
        except UnreadableError as err:
            raise InstrumentError(f"{self._who}: {err}; check the cable, and that it is a {self.NAME}") from err
        note_recovered(f"{self._who}: {garbled}")
        return answer

    @abstractmethod
    def _configuration(self, line_cycles: int) -> tuple[str, ...]:
        """Return the commands that set up both channels after a reset."""

    @abstractmethod
    def _scans(self) -> bool:
        """Return whether a scan runs."""

    @abstractmethod
    def _single(self) -> str:
        """Take one scan and return its readings: value and time of each channel."""

    @abstractmethod
    def _start(self, interval_s: str) -> None:
        """Start a scan every `interval_s`, without end; the memory is empty then."""

    @abstractmethod
    def _ready(self, fetched: int) -> int:
        """Return the number of scans in memory that were not fetched."""

    @abstractmethod
    def _fetch(self, fetched: int, scans: int) -> str:
        """Return the readings of the next scans: value and time [s since the first reading] of each channel."""
