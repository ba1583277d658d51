"""What drivers do alike whose controllers know constant rates and angles, one after the other, and no sinusoid."""

from __future__ import annotations

import math
import threading
from abc import ABC, abstractmethod
from typing import ClassVar, Generic, Self, TypeVar

from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Clock, TableReading
from benchctl_instruments.protocols.lines import parse_number
from benchctl_instruments.rate_tables.axis_dialogue import AxisDialogue
from benchctl_instruments.rate_tables.kept_limits import KeptLimits, refuse_to_oscillate, wait_until

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


class ConstantRateTable(ABC, Generic[Dialogue]):
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

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

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
