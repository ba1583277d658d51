"""What drivers do alike whose controllers know constant rates and angles, one after the other, and no sinusoid.

The driver itself keeps the limit on the rate, which such a controller does not have. Dialogues with one axis are lines
of text in which `{axis}` stands for the axis.
"""

from __future__ import annotations

import math
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar, Generic, NoReturn, TypeVar

from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Clock, Instrument, TableLimits, TableReading
from benchctl_instruments.links.lines import LineDialogue
from benchctl_instruments.links.wirelog import note_recovered
from benchctl_instruments.protocols.lines import parse_number

Parsed = TypeVar("Parsed")


class AxisDialogue(ABC):
    """Queries, and commands that are up to the controller; every exchange is safe from several threads.

    Junk in place of an answer is asked for once more, as silence is: `benchctl_instruments.links.lines` says how.

    Parameters
    ----------
    line
        The dialogue in lines; this one opens and closes it.
    axis
        The controller's number of the axis.
    """

    def __init__(self, line: LineDialogue, *, axis: int) -> None:
        self._line = line
        self._axis = axis
        self.who = line.who

    def open(self) -> None:
        """Connect; whether the right controller answers shows with the first question."""
        self._line.open()

    def close(self) -> None:
        """Let go of the link; safe to call twice, and never raises."""
        self._line.close()

    def ask(self, query: str, parse: Callable[[str], Parsed]) -> Parsed:
        """What `parse` makes of the answer to a query; it raises `InstrumentError` for what that cannot be."""
        text = self._text(query)
        try:
            return self._ask_once(text, parse)
        except InstrumentError as err:
            value = self._ask_once(text, parse)
            note_recovered(str(err))
            return value

    @abstractmethod
    def _ask_once(self, text: str, parse: Callable[[str], Parsed]) -> Parsed:
        """As `ask`, without a second try at what cannot be read."""

    def _text(self, pattern: str, *values: float) -> str:
        """A line, its `{}` filled with values."""
        return pattern.format(*(f"{value:.6f}" for value in values), axis=self._axis)


_LONGEST_STOP_S = 30.0  # bench time, where no limits are known
_POLL_S = 0.05
_SPARE_S = 2.0


class KeptLimits:
    """The limits of a table as its driver keeps them: no motion before they are known, none beyond them.

    Parameters
    ----------
    name
        How error messages call the table.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._limits: TableLimits | None = None

    def keep(self, limits: TableLimits) -> None:
        """From now on these; `UsageError` where they are not both finite and above 0."""
        for what, value in (("rate", limits.rate_dps), ("acceleration", limits.acceleration_dps2)):
            if not (math.isfinite(value) and value > 0.0):
                raise UsageError(f"{self._name}: {what} limit {value}: expected a finite number above 0")
        self._limits = limits

    def known(self) -> TableLimits:
        """The limits; `UsageError` before they were set."""
        if self._limits is None:
            raise UsageError(
                f"{self._name}: it was to move before its limits were set, and its controller keeps none on the rate;"
                " call set_limits() first"
            )
        return self._limits

    def check_rate(self, rate_dps: float) -> None:
        """Raise `UsageError` for a rate that is no number or beyond the limit; 0 is allowed before limits are known."""
        check_finite(self._name, "rate", rate_dps)
        if rate_dps and abs(rate_dps) > self.known().rate_dps:
            raise UsageError(
                f"{self._name}: asked for {rate_dps:g} deg/s, the limit that was set is {self.known().rate_dps:g} deg/s"
            )

    def longest_stop_s(self) -> float:
        """How long a stop may take at most, in bench time."""
        if self._limits is None:
            return _LONGEST_STOP_S
        return _SPARE_S + 2.0 * self._limits.rate_dps / self._limits.acceleration_dps2


def check_finite(name: str, what: str, value: float) -> None:
    """Raise `UsageError` for what is no finite number."""
    if not math.isfinite(value):
        raise UsageError(f"{name}: {what} {value}: expected a finite number")


def refuse_to_oscillate(name: str, controller: str) -> NoReturn:
    """Raise the `UsageError` of a controller for which no sinusoid is publicly known."""
    raise UsageError(
        f"{name}: an oscillation was asked for, and no public source describes one for the {controller}: procedures"
        " with sines or swings (sine_sweep, two_stage, diagnostic) cannot run on it; take one of constant rates"
        " (rate_sweep, temperature_sweep) or one at rest (static)"
    )


def wait_until(clock: Clock, done: Callable[[], bool], within_s: float) -> bool:
    """Look until something is done, at most so much bench time; whether it is."""
    deadline_s = clock.now() + within_s
    while not done():
        if clock.now() >= deadline_s:
            return False
        clock.sleep(_POLL_S)
    return True


def short_way_deg(from_deg: float, to_deg: float) -> float:
    """The shorter way from one angle to another, -180 to below 180 degrees, positive as the angles are."""
    return (to_deg - from_deg + 180.0) % 360.0 - 180.0


SHORTEST_S = 0.04
"""Reads closer together are not compared: what the rate may be off would hide any acceleration."""


class ProvenAcceleration:
    """Follows the rate from read to read; not for two threads at once.

    A rate was measured at some instant between its question and its answer, and may be off. Of all accelerations that
    fit two reads, the one nearest to zero is stated: the smallest change of the rate over the longest time. So neither
    noise nor a slow line ever makes an acceleration, and what is stated is a mean: of a jolt between two reads, only
    what it has left of the rate shows.

    Parameters
    ----------
    clock
        Bench time.
    rate_error_dps
        How much a rate may be off.
    """

    def __init__(self, clock: Clock, rate_error_dps: float) -> None:
        self._clock = clock
        self._error_dps = rate_error_dps
        self._rate_dps = self._asked_s = math.nan

    def forget(self) -> None:
        """The next read is the first one."""
        self._rate_dps = self._asked_s = math.nan

    def of(self, rate_dps: float, asked_s: float) -> float:
        """The mean acceleration [deg/s²] since the read before, where `rate_dps` was asked for at `asked_s`.

        Not a number at the first read, and at one that comes too early.
        """
        longest_s = self._clock.now() - self._asked_s
        if longest_s < SHORTEST_S:
            return math.nan
        change_dps = rate_dps - self._rate_dps
        self._rate_dps, self._asked_s = rate_dps, asked_s
        return math.copysign(max(0.0, abs(change_dps) - 2.0 * self._error_dps) / longest_s, change_dps)


Dialogue = TypeVar("Dialogue", bound=AxisDialogue)

LEAST = 1e-6  # deg, deg/s: less than this is written as nothing


class ConstantRateTable(Instrument, ABC, Generic[Dialogue]):
    """One axis of such a controller. Safe to call from several threads.

    | hook              | what it does                                                                 |
    |-------------------|------------------------------------------------------------------------------|
    | `_controller`     | names the controller in error messages                                       |
    | `_ask_angle`      | the query for the angle [deg]                                                |
    | `_ask_rate`       | the query for the rate [deg/s]                                               |
    | `_check`          | raises where something else answers                                          |
    | `_moves`          | whether the table moves                                                      |
    | `_begin_to_stop`  | has it stop, before another motion                                           |
    | `_switch_off`     | takes the servo off a table at rest, and confirms it                         |

    Parameters
    ----------
    line
        The dialogue with the axis.
    clockwise
        Whether the controller counts clockwise, seen from above.
    rest_rate_dps
        Up to this rate the table counts as at rest; no rate that is read is off by more.
    """

    oscillates: ClassVar[bool] = False

    _controller: ClassVar[str]
    _ask_angle: ClassVar[str]
    _ask_rate: ClassVar[str]

    def __init__(self, line: Dialogue, *, clock: Clock, clockwise: bool, rest_rate_dps: float) -> None:
        self._line = line
        self._name = line.who
        self._limits = KeptLimits(self._name)
        self._acceleration = ProvenAcceleration(clock, rest_rate_dps)
        self._clock = clock
        self._sign = -1.0 if clockwise else 1.0
        self._rest_rate_dps = rest_rate_dps
        self._lock = threading.RLock()  # a method's commands and their confirmation belong together

    # What every instrument does ---------------------------------------------------------------------------------------

    def open(self) -> None:
        """Connect, and make sure that the right controller answers."""
        self._acceleration.forget()
        self._line.open()
        try:
            self._check()
        except (LinkError, InstrumentError):
            self._line.close()
            raise

    def close(self) -> None:
        """Let go of the link; the table goes on with what it was doing."""
        self._line.close()

    # What a rate table does -------------------------------------------------------------------------------------------

    def disable(self) -> None:
        """Servo off; `UsageError` while the table moves."""
        with self._lock:
            rate_dps = self._rate_dps()
            if abs(rate_dps) > self._rest_rate_dps:
                raise UsageError(f"{self._name}: it turns at {rate_dps:.3f} deg/s; stop it before it is disabled")
            self._switch_off()

    def oscillate(self, amplitude_dps: float, frequency_hz: float) -> None:
        """Always `UsageError`: nobody has published how to ask for it."""
        refuse_to_oscillate(self._name, self._controller)

    def read(self) -> TableReading:
        """Angle and rate, by two queries; the controller does not say the acceleration: what the rates prove."""
        with self._lock:
            angle_deg = self._angle_deg()
            asked_s = self._clock.now()
            rate_dps = self._rate_dps()
            return TableReading(
                angle_deg=angle_deg % 360.0,
                rate_dps=rate_dps,
                acceleration_dps2=self._acceleration.of(rate_dps, asked_s),
            )

    # Hooks ------------------------------------------------------------------------------------------------------------

    @abstractmethod
    def _check(self) -> None: ...

    @abstractmethod
    def _moves(self) -> bool: ...

    @abstractmethod
    def _begin_to_stop(self) -> None: ...

    @abstractmethod
    def _switch_off(self) -> None: ...

    def _come_to_rest(self) -> None:
        if not self._moves():
            return
        self._begin_to_stop()
        if not wait_until(self._clock, lambda: not self._moves(), self._limits.longest_stop_s()):
            raise InstrumentError(
                f"{self._name}: it was told to stop before its next motion, and still moves, at"
                f" {self._rate_dps():.3f} deg/s; look at the controller"
            )

    def _angle_deg(self) -> float:
        return self._sign * self._line.ask(self._ask_angle, parse_number)

    def _rate_dps(self) -> float:
        return self._sign * self._line.ask(self._ask_rate, parse_number) + 0.0  # which makes 0 of -0
