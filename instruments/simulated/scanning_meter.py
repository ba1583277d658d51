"""What the simulated scanning multimeters have in common: SCPI, a queue of errors, a memory of readings, a scan timer.

Behaviour chosen without a source: a scan without a timer takes no time, although the time stamps of its channels
differ; a channel without a wire and the front terminals read 0 V; a channel set to a temperature reads the number of
its terminal's volts as °C, so that the sensor is right where bench.toml has `thermistor_c_per_v = 1`. Readings have six
digits of their range.
"""

from __future__ import annotations

import inspect
import math
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols import scpi
from benchctl_instruments.protocols.lines import parse_number
from benchctl_instruments.simulated.machines import SINGLE_READING_S, AnalogInputs
from benchctl_instruments.simulated.serial_line import LineServer

DIGITS = 1e-6
CHANNEL_S = 0.04
OVER = 1.2  # of the range
LONGEST_WAIT_S = 30.0  # wall time
MOST_ERRORS = 20

NO_ERROR = (0, "No error")
UNDEFINED_HEADER, MISSING_PARAMETER = (-113, "Undefined header"), (-109, "Missing parameter")
INIT_IGNORED, OUT_OF_RANGE, ILLEGAL_VALUE = (
    (-213, "Init ignored"),
    (-222, "Data out of range"),
    (-224, "Illegal parameter value"),
)

Handler = Callable[..., str | None]


class RefusedError(Exception):
    """The meter puts an error into its queue; the first two arguments are its code and text."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """A reading, its time since the first one of the scan [s], and its channel."""

    value: float
    time_s: float
    channel: int


@dataclass(slots=True, kw_only=True)
class Scan:
    """A running scan: `taken` of `count` passes through the channels, `interval_s` apart, the first at `first_s`."""

    channels: tuple[int, ...]
    first_s: float
    interval_s: float
    count: float
    taken: int = 0


class SimulatedMeter(ABC):
    """The meter's states over `AnalogInputs`, without I/O. Thread-safe.

    Parameters
    ----------
    inputs
        The signals at its terminals.
    gyro_channel, thermistor_channel
        Where they are wired.
    """

    IDENTITY: str

    def __init__(self, inputs: AnalogInputs, *, gyro_channel: int, thermistor_channel: int) -> None:
        self._inputs, self._wired = inputs, (gyro_channel, thermistor_channel)
        self._lock = threading.Lock()
        self._errors: deque[tuple[int, str]] = deque(maxlen=MOST_ERRORS)
        self._handlers: dict[str, Handler] = {
            "*IDN?": lambda: self.IDENTITY,
            "*RST": self._reset,
            "*CLS": lambda: self._errors.clear(),
            "*OPC?": self._finished,
            "*WAI": self._finish,
            "SYSTem:ERRor[:NEXT]?": self._next_error,
            "ABORt": self._abort,
            "INITiate[:IMMediate]": self._initiate,
            **self._own_handlers(),
        }
        self._reset()

    def execute(self, line: str) -> str | None:
        """Execute one line; return the answers to its queries, separated by semicolons, or None."""
        with self._lock:
            answers = [self._answer(command) for command in scpi.parse_commands(line)]
        return ";".join(answer for answer in answers if answer is not None) or None

    def _answer(self, command: scpi.ScpiCommand) -> str | None:
        self._advance()
        try:
            handler = self._handler(command.header)
            try:
                inspect.signature(handler).bind(*command.arguments)
            except TypeError:
                raise RefusedError(*MISSING_PARAMETER) from None
            return handler(*command.arguments)
        except RefusedError as err:
            self._errors.append((err.args[0], err.args[1]))
        except InstrumentError:  # no number, or no list of channels
            self._errors.append(ILLEGAL_VALUE)
        return None

    def _handler(self, header: str) -> Handler:
        for written, handler in self._handlers.items():
            if scpi.header_pattern(written).fullmatch(header):
                return handler
        raise RefusedError(*UNDEFINED_HEADER)

    def _next_error(self) -> str:
        code, text = self._errors.popleft() if self._errors else NO_ERROR
        return self._error_text(code, text)

    def _reset(self) -> None:
        self._readings: deque[Reading] = deque()
        self._scan: Scan | None = None
        self._inputs.hold_history(None)
        self._function: dict[int, str] = {}
        self._range_v: dict[int, float] = {}
        self._nplc: dict[int, float] = {}
        self._channels: tuple[int, ...] = ()
        self._reset_more()

    def _abort(self) -> None:
        self._scan = None
        self._inputs.hold_history(None)

    def _initiate(self) -> None:
        if self._scan is not None:
            raise RefusedError(*INIT_IGNORED)
        interval_s, count = self._timing()
        self._readings.clear()
        first_s = self._inputs.now()
        self._inputs.hold_history(first_s)
        self._scan = Scan(channels=self._channels, first_s=first_s, interval_s=interval_s, count=count)
        self._advance()

    def _finish(self) -> None:
        """Wait for the end of a scan that has one."""
        scan = self._scan
        if scan is not None and math.isfinite(scan.count):
            self._inputs.wait_until(scan.first_s + (scan.count - 1) * scan.interval_s, LONGEST_WAIT_S)
        self._advance()

    def _finished(self) -> str:
        self._finish()
        return "1"

    def _advance(self) -> None:
        """Take the readings that are due."""
        scan = self._scan
        if scan is None:
            return
        passed_s = self._inputs.now() - scan.first_s
        due = scan.count if not scan.interval_s else min(scan.count, math.floor(passed_s / scan.interval_s + 1e-6) + 1)
        if (few := int(due) - scan.taken) > 0:
            step_s = scan.interval_s or SINGLE_READING_S / few
            first_s = scan.first_s if scan.interval_s else self._inputs.now() - (few - 1) * step_s
            _, *volts = self._inputs.sample(first_s, step_s, few, start=scan.taken)
            for index in range(few):
                seen = {channel: float(volts[place][index]) for place, channel in enumerate(self._wired)}
                time_s = (scan.taken + index) * scan.interval_s
                self._store(
                    [
                        Reading(value=self._shown(channel, seen), time_s=time_s + place * CHANNEL_S, channel=channel)
                        for place, channel in enumerate(scan.channels)
                    ]
                )
            scan.taken += few
            self._inputs.hold_history(scan.first_s + scan.taken * scan.interval_s)
        if scan.taken >= scan.count:
            self._abort()

    def _store(self, readings: list[Reading]) -> None:
        self._readings.extend(readings)

    def _now_v(self, channel: int | None) -> float:
        """Return what a single measurement of a channel, or of the front terminals (None), shows now."""
        _, *volts = self._inputs.sample(self._inputs.now(), SINGLE_READING_S, 1)
        return self._shown(channel or 0, {wired: float(v[0]) for wired, v in zip(self._wired, volts, strict=True)})

    def _shown(self, channel: int, seen: Mapping[int, float]) -> float:
        value, range_v = seen.get(channel, 0.0), self._range_v.get(channel, 10.0)
        if self._function.get(channel, "VOLT").startswith("VOLT") and abs(value) > OVER * range_v:
            return math.copysign(scpi.OVERLOAD, value)
        return round(value / (DIGITS * range_v)) * DIGITS * range_v

    def _set_each(self, store: dict[int, float], number: str, channels: str, highest: float) -> None:
        value = parse_number(number)
        if not 0.0 < value <= highest:
            raise RefusedError(*OUT_OF_RANGE)
        store.update(dict.fromkeys(scpi.parse_channels(channels), value))

    def _known(self, word: str, words: tuple[str, ...]) -> None:
        if word.upper() not in words:
            raise InstrumentError(f"expected one of {words}, got {word!r}")

    @abstractmethod
    def _own_handlers(self) -> dict[str, Handler]:
        """Return the commands of the model, as written in manuals."""

    @abstractmethod
    def _reset_more(self) -> None:
        """Reset what only this model has."""

    @abstractmethod
    def _timing(self) -> tuple[float, float]:
        """Return interval [s], 0 without a timer, and number of the scans to come, or refuse to start."""

    @abstractmethod
    def _error_text(self, code: int, text: str) -> str:
        """Return an error as the model formats it."""


class MeterServer(LineServer):
    """A meter from `start()` to `stop()`, or in a `with`.

    Parameters
    ----------
    inputs, gyro_channel, thermistor_channel
        See `SimulatedMeter`.
    over_tcp
        See `LineServer`.
    """

    METER: ClassVar[type[SimulatedMeter]]

    def __init__(
        self,
        inputs: AnalogInputs,
        *,
        gyro_channel: int = 101,
        thermistor_channel: int = 102,
        over_tcp: bool = True,
    ) -> None:
        meter = self.METER(inputs, gyro_channel=gyro_channel, thermistor_channel=thermistor_channel)
        super().__init__(meter.execute, over_tcp=over_tcp, end=b"\n")
