"""The common part of drivers whose controllers support constant rates and angles, but no sinusoid.

The driver itself keeps the limit on the rate, which such a controller does not have. Dialogues with one axis, those of
an ACUTROL3000 too, are lines of text with the placeholder `{axis}`.
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
    """Queries and commands of one axis; a controller's dialogue implements the commands. All exchanges are thread-safe.

    An unreadable answer is requested a second time, as a missing one is: see `benchctl_instruments.links.lines`.

    Parameters
    ----------
    line
        The line dialogue; this class opens and closes it.
    axis
        The controller's number of the axis.
    """

    def __init__(self, line: LineDialogue, *, axis: int) -> None:
        self._line = line
        self._axis = axis
        self.who = line.who

    def open(self) -> None:
        """Connect; the first question shows whether the right controller answers."""
        self._line.open()

    def close(self) -> None:
        """Close the link; safe to call twice, and never raises."""
        self._line.close()

    def ask(self, query: str, parse: Callable[[str], Parsed]) -> Parsed:
        """Return the answer to a query after `parse`, which raises `InstrumentError` for an invalid answer."""
        text = self._text(query)
        try:
            return self._ask_once(text, parse)
        except InstrumentError as err:
            value = self._ask_once(text, parse)
            note_recovered(str(err))
            return value

    @abstractmethod
    def _ask_once(self, text: str, parse: Callable[[str], Parsed]) -> Parsed:
        """Do the same as `ask`, without a second attempt after an unreadable answer."""

    def _text(self, pattern: str, *values: float) -> str:
        """Return a line, its `{}` filled with values."""
        return pattern.format(*(f"{value:.6f}" for value in values), axis=self._axis)


_LONGEST_STOP_S = 30.0  # bench time, if no limits are known
_POLL_S = 0.05
_SPARE_S = 2.0
_HOME_DPS = 10.0


class KeptLimits:
    """The limits of a table, kept by its driver: no motion before they are set, none beyond them.

    Parameters
    ----------
    name
        The name of the table in error messages.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._limits: TableLimits | None = None

    def keep(self, limits: TableLimits) -> None:
        """Set the limits; raises `UsageError` if they are not both finite and above 0."""
        for what, value in (("rate", limits.rate_dps), ("acceleration", limits.acceleration_dps2)):
            if not (math.isfinite(value) and value > 0.0):
                raise UsageError(f"{self._name}: {what} limit {value}: expected a finite number above 0")
        self._limits = limits

    def known(self) -> TableLimits:
        """Return the limits; raises `UsageError` before they are set."""
        if self._limits is None:
            raise UsageError(
                f"{self._name}: commanded to move before its limits were set, and its controller has none on the rate;"
                " call set_limits() first"
            )
        return self._limits

    def check_rate(self, rate_dps: float) -> None:
        """Raise `UsageError` for a rate that is not finite or beyond the limit; 0 is allowed before limits are set."""
        check_finite(self._name, "rate", rate_dps)
        if rate_dps and abs(rate_dps) > self.known().rate_dps:
            raise UsageError(
                f"{self._name}: commanded {rate_dps:g} deg/s, the limit that was set is {self.known().rate_dps:g} deg/s"
            )

    def longest_stop_s(self) -> float:
        """Return the longest duration of a stop, in bench time."""
        if self._limits is None:
            return _LONGEST_STOP_S
        return _SPARE_S + 2.0 * self._limits.rate_dps / self._limits.acceleration_dps2


def check_finite(name: str, what: str, value: float) -> None:
    """Raise `UsageError` if a value is not finite."""
    if not math.isfinite(value):
        raise UsageError(f"{name}: {what} {value}: expected a finite number")


def refuse_to_oscillate(name: str, controller: str) -> NoReturn:
    """Raise the `UsageError` of a controller for which no sinusoid is publicly documented."""
    raise UsageError(
        f"{name}: an oscillation was commanded, and no public source describes one for the {controller}: procedures"
        " with sines or swings (sine_sweep, two_stage, diagnostic) cannot run on it; take one of constant rates"
        " (rate_sweep, temperature_sweep) or one at rest (static)"
    )


def wait_until(clock: Clock, done: Callable[[], bool], within_s: float) -> bool:
    """Poll until `done` returns true, at most `within_s` of bench time; return whether it did."""
    deadline_s = clock.now() + within_s
    while not done():
        if clock.now() >= deadline_s:
            return False
        clock.sleep(_POLL_S)
    return True


def short_way_deg(from_deg: float, to_deg: float) -> float:
    """Return the shorter way from one angle to another, -180 to below 180 degrees, with the sign of the angles."""
    return (to_deg - from_deg + 180.0) % 360.0 - 180.0


SHORTEST_S = 0.04
"""Reads closer together are not compared: the error of the rate would hide any acceleration."""


class ProvenAcceleration:
    """Derive the acceleration from successive reads of the rate. Not thread-safe.

    A rate was measured at some instant between its question and its answer, and has an error. Of all accelerations that
    agree with two reads, the one nearest to zero is returned: the smallest change of the rate over the longest time.
    Noise or a slow line therefore never causes an acceleration, and the result is a mean: a jolt between two reads is
    only visible in the remaining change of the rate.

    Parameters
    ----------
    clock
        Bench time.
    rate_error_dps
        Largest error of a rate.
    """

    def __init__(self, clock: Clock, rate_error_dps: float) -> None:
        self._clock = clock
        self._error_dps = rate_error_dps
        self._rate_dps = self._asked_s = math.nan

    def forget(self) -> None:
        """Treat the next read as the first one."""
        self._rate_dps = self._asked_s = math.nan

    def of(self, rate_dps: float, asked_s: float) -> float:
        """Return the mean acceleration [deg/s²] since the previous read; `rate_dps` was requested at `asked_s`.

        Returns NaN for the first read, and for one that is too early.
        """
        longest_s = self._clock.now() - self._asked_s
        if longest_s < SHORTEST_S:
            return math.nan
        change_dps = rate_dps - self._rate_dps
        self._rate_dps, self._asked_s = rate_dps, asked_s
        return math.copysign(max(0.0, abs(change_dps) - 2.0 * self._error_dps) / longest_s, change_dps)


Dialogue = TypeVar("Dialogue", bound=AxisDialogue)

LEAST = 1e-6  # deg, deg/s: smaller values are treated as 0


class ConstantRateTable(Instrument, ABC, Generic[Dialogue]):
    """One axis of such a controller. Thread-safe.

    | hook              | meaning                                                                      |
    |-------------------|------------------------------------------------------------------------------|
    | `_controller`     | name of the controller in error messages                                     |
    | `_ask_angle`      | the query for the angle [deg]                                                |
    | `_ask_rate`       | the query for the rate [deg/s]                                               |
    | `_check`          | raises if another instrument answers                                         |
    | `_moves`          | returns whether the table moves                                              |
    | `_begin_to_stop`  | starts a stop before another motion                                          |
    | `_switch_off`     | switches the servo of a table at rest off, and confirms it                   |
    | `_begin_to_home`  | sets the rate [deg/s] of a table at rest for homing, and starts it           |
    | `_is_homed`       | returns whether homing has ended; raises if it ended elsewhere               |

    Parameters
    ----------
    line
        The dialogue with the axis.
    clockwise
        Whether the controller counts clockwise from above.
    rest_rate_dps
        Up to this rate the table counts as at rest; also the largest error of a measured rate.
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

    # Methods of all instruments ---------------------------------------------------------------------------------------

    def open(self) -> None:
        """Connect and check that the right controller answers."""
        self._acceleration.forget()
        self._line.open()
        try:
            self._check()
        except (LinkError, InstrumentError):
            self._line.close()
            raise

    def close(self) -> None:
        """Close the link; the table continues its motion."""
        self._line.close()

    # Methods of rate tables -------------------------------------------------------------------------------------------

    def disable(self) -> None:
        """Switch the servo off; raises `UsageError` while the table moves."""
        with self._lock:
            rate_dps = self._rate_dps()
            if abs(rate_dps) > self._rest_rate_dps:
                raise UsageError(f"{self._name}: it turns at {rate_dps:.3f} deg/s; stop it before it is disabled")
            self._switch_off()

    def oscillate(self, amplitude_dps: float, frequency_hz: float) -> None:
        """Always raise `UsageError`: no public source documents the commands."""
        refuse_to_oscillate(self._name, self._controller)

    def home(self, meanwhile: Callable[[], None]) -> None:
        """Turn at 10 deg/s at most to the home mark, from which the angle then counts; see `interfaces.Homes`."""
        with self._lock:
            rate_dps = min(_HOME_DPS, self._limits.known().rate_dps)
            self._come_to_rest()
            self._begin_to_home(rate_dps)
        deadline_s = self._clock.now() + 2.0 * 360.0 / rate_dps + self._limits.longest_stop_s()
        meanwhile()
        while not self._is_homed():
            if self._clock.now() > deadline_s:
                raise InstrumentError(
                    f"{self._name}: homing was commanded and does not end; it turns at {self._rate_dps():.3f} deg/s;"
                    " look at the home mark and the controller"
                )
            meanwhile()
        self._acceleration.forget()

    def read(self) -> TableReading:
        """Return angle and rate from two queries; the acceleration is derived from the rates."""
        with self._lock:
            angle_deg = self._angle_deg()
            queried_s = self._clock.now()
            rate_dps = self._rate_dps()
            return TableReading(
                angle_deg=angle_deg % 360.0,
                rate_dps=rate_dps,
                acceleration_dps2=self._acceleration.of(rate_dps, queried_s),
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

    @abstractmethod
    def _begin_to_home(self, rate_dps: float) -> None: ...

    @abstractmethod
    def _is_homed(self) -> bool: ...

    def _come_to_rest(self) -> None:
        if not self._moves():
            return
        self._begin_to_stop()
        if not wait_until(self._clock, lambda: not self._moves(), self._limits.longest_stop_s()):
            raise InstrumentError(
                f"{self._name}: a stop before its next motion was commanded, and it still moves, at"
                f" {self._rate_dps():.3f} deg/s; look at the controller"
            )

    def _angle_deg(self) -> float:
        return self._sign * self._line.ask(self._ask_angle, parse_number)

    def _rate_dps(self) -> float:
        return self._sign * self._line.ask(self._ask_rate, parse_number) + 0.0  # converts -0 to 0
