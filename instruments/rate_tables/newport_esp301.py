"""Rotary stage on a Newport ESP301 controller, by its commands on a serial line. Not tried on hardware.

Source: published driver code, see `instruments.protocols.esp301`. The axis must count in degrees. The line is 19200
baud, 8N1, as an ESP301 has it; an ESP302 answers at TCP port 5001 as well. What follows from the sources, and is done
here:

- Nothing but a query is answered, so the queue of errors is emptied after every command, and what is set is read back.
- A rate is `MV+` or `MV-` at the velocity `VA`. Another rate in the same direction is a new `VA`. Before the other
  direction, and before an angle, a table that moves is brought to rest, and the call returns after that. `WS` would
  let the controller wait by itself, but it would then not hear `ST` either.
- A fault shows only in the queue, once. So the driver remembers it until the table is enabled again, and stops the
  table, whatever the controller is set up to do. A table that should turn and has come to rest is in fault too, since
  an answer out of the queue may have been lost on the line.
- An ESP300 was seen to say an error unasked before an answer; such a line is left out, the queue has it too.
- Acceleration and deceleration are programmed. The limit on the rate is kept by the driver, which refuses what lies
  beyond; a software limit of the angle (`SL`, `SR`), where one is set, is a fault when a turning table meets it.
- No public source describes a sinusoid: `oscillate` is refused.

What it does about faults: a query that is not answered, or not so that it can be read, is asked once more on a line
opened anew. A command that is lost on the way is found out by reading back and is an `InstrumentError`; so is every
error in the queue. An emergency stop, a following error and a velocity trip make `state` FAULT, a restart makes it
DISABLED, and nothing moves until the table is enabled again.

`clockwise=True` where the stage counts clockwise, seen from above: no source says, compare with the gyro.
"""

from __future__ import annotations

import math
import threading
from typing import Self

from instruments.errors import InstrumentError, LinkError, UsageError
from instruments.interfaces import Clock, Identity, TableLimits, TableReading, TableState
from instruments.links.byte_link import byte_link
from instruments.links.lines import NoAnswerError
from instruments.links.tcp import Reconnect
from instruments.links.wirelog import WireLog
from instruments.protocols.esp301 import DEGREES, Error, parse_flag, parse_number
from instruments.rate_tables.esp301_dialogue import Esp301Dialogue, listed
from instruments.rate_tables.kept_limits import (
    KeptLimits,
    check_finite,
    refuse_to_oscillate,
    short_way_deg,
    wait_until,
)

ASK_VERSION = "VE?"
ASK_UNITS = "{axis}SN?"
ASK_ON = "{axis}MO?"
ASK_AT_REST = "{axis}MD?"
ASK_ANGLE = "{axis}TP?"  # deg
ASK_RATE = "{axis}TV?"  # deg/s

ON = "{axis}MO"
OFF = "{axis}MF"
STOP = "{axis}ST"
TURN = {1: "{axis}MV+", -1: "{axis}MV-"}
GO_TO = "{axis}PA{}"
VELOCITY = "{axis}VA"  # deg/s
RAMPS = ("{axis}AC", "{axis}AG")  # acceleration, deceleration [deg/s²]

LEAST = 1e-6  # deg/s: less than this is written as nothing
NEAR_DEG = 0.1  # so near to an angle, a table at rest has reached it


class Esp301:
    """One axis of an ESP301; an `instruments.interfaces.RateTable`. Safe to call from several threads.

    Parameters
    ----------
    address
        `serial://DEVICE?baud=19200`, `socket://HOST:PORT`, or `tcp://HOST:5001` of an ESP302.
    axis
        The controller's number of the axis, from 1.
    clockwise
        Whether the controller counts clockwise, seen from above.
    timeout_s
        How long to wait for a whole answer; wall time.
    rest_rate_dps
        Up to this rate the table counts as at rest.
    """

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        axis: int = 1,
        clockwise: bool = False,
        timeout_s: float = 2.0,
        rest_rate_dps: float = 0.05,
        reconnect: Reconnect | None = None,
        wire_log: WireLog | None = None,
    ) -> None:
        self._line = Esp301Dialogue(
            byte_link(address, reconnect=reconnect, wire_log=wire_log),
            axis=axis,
            timeout_s=timeout_s,
            clock=clock,
            on_fault=self._meet_fault,
        )
        self._name = self._line.who
        self._limits = KeptLimits(self._name)
        self._clock = clock
        self._axis = axis
        self._sign = -1.0 if clockwise else 1.0
        self._rest_rate_dps = rest_rate_dps
        self._turns = 0  # the direction of an `MV` that goes on, as far as is known here
        self._faults: list[str] = []  # since the table was enabled, in words
        self._lock = threading.RLock()  # a method's commands and their confirmation belong together

    # What every instrument does ---------------------------------------------------------------------------------------

    def open(self) -> None:
        """Connect, and make sure that an ESP30x answers and that the axis is there and counts in degrees."""
        self._line.open()
        try:
            version = self._line.ask(ASK_VERSION, str)
            if "ESP" not in version.upper():
                raise InstrumentError(
                    f"{self._name}: asked {ASK_VERSION!r}, expected ESP301 and a version, got {version!r};"
                    " check that the address is an ESP301's"
                )
            self._check_axis()
        except (LinkError, InstrumentError):
            self._line.close()
            raise

    def close(self) -> None:
        """Let go of the link; the table goes on with what it was doing."""
        self._line.close()

    def identify(self) -> Identity:
        """Model and firmware, as `VE?` says them."""
        model, _, firmware = self._line.ask(ASK_VERSION, str).partition(" ")
        return Identity(model=model, firmware=firmware.strip())

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    # What a rate table does -------------------------------------------------------------------------------------------

    def set_limits(self, limits: TableLimits) -> None:
        """Program acceleration and deceleration; keep the limit on the rate."""
        with self._lock:
            self._limits.keep(limits)
            for setting in RAMPS:
                self._line.write(setting, limits.acceleration_dps2)

    def enable(self) -> None:
        """Empty the queue of errors, forget faults, motor on, hold still."""
        with self._lock:
            self._line.take_errors()
            self._faults.clear()
            self._line.tell(ON)
            self._stop()
            self._confirm("enabling")

    def disable(self) -> None:
        """Motor off; `UsageError` while the table moves."""
        with self._lock:
            rate_dps = self._rate_dps()
            if abs(rate_dps) > self._rest_rate_dps:
                raise UsageError(f"{self._name}: it turns at {rate_dps:.3f} deg/s, stop it before it is disabled")
            self._turns = 0
            self._line.tell(OFF)
            if self._is_on():
                raise InstrumentError(f"{self._name}: its motor was told to be off, and is still on")

    def go_to_rate(self, rate_dps: float) -> None:
        """Turn at a constant rate; returns at once, but before another direction the table is brought to rest."""
        self._limits.check_rate(rate_dps)
        direction = int(math.copysign(1.0, self._sign * rate_dps))
        with self._lock:
            if abs(rate_dps) < LEAST:
                self._stop()
            elif self._turns == direction and not self._at_rest():
                self._line.write(VELOCITY, abs(rate_dps))
            else:
                self._look_for_faults(f"a rate of {rate_dps:g} deg/s is asked for")
                self._come_to_rest()
                self._line.write(VELOCITY, abs(rate_dps))
                self._line.tell(TURN[direction])
                self._turns = direction
            self._confirm(f"a rate of {rate_dps:g} deg/s")

    def go_to_angle(self, angle_deg: float) -> None:
        """Turn to an angle the short way round; returns at once, but a table that moves is brought to rest first."""
        check_finite(self._name, "angle", angle_deg)
        with self._lock:
            rate_dps = self._limits.known().rate_dps
            self._look_for_faults(f"an angle of {angle_deg:g} deg is asked for")
            self._come_to_rest()
            self._line.write(VELOCITY, rate_dps)
            here_deg = self._angle_deg()
            target_deg = here_deg + short_way_deg(here_deg, angle_deg)
            self._line.tell(GO_TO, self._sign * target_deg)
            self._confirm(f"an angle of {angle_deg:g} deg")
            if self._at_rest() and abs(self._angle_deg() - target_deg) > NEAR_DEG:
                raise InstrumentError(
                    f"{self._name}: an angle of {angle_deg:g} deg was asked for and not refused, and the table stands"
                    f" still at {self._angle_deg() % 360.0:g} deg; look at the controller"
                )

    def oscillate(self, amplitude_dps: float, frequency_hz: float) -> None:
        """Always `UsageError`: nobody has published how to ask for it."""
        refuse_to_oscillate(self._name, "ESP301")

    def stop(self) -> None:
        """Stop within the deceleration; a table whose motor is off without a fault is left alone."""
        with self._lock:
            self._turns = 0
            for _ in range(2):  # nothing answers it, and one lost line must not leave the table turning
                self._line.say(STOP)
                errors = self._line.take_errors()
            self._fail_on_fault("it was told to stop")
            if errors and self._is_on():
                raise InstrumentError(f"{self._name}: it was told to stop and reports {listed(errors)}")

    def read(self) -> TableReading:
        """Angle and rate, by two queries; the controller does not say the acceleration: not a number."""
        with self._lock:
            return TableReading(
                angle_deg=self._angle_deg() % 360.0, rate_dps=self._rate_dps(), acceleration_dps2=math.nan
            )

    def state(self) -> TableState:
        """A fault since the table was enabled before disabled before moving."""
        with self._lock:
            if self._found_faults():
                return TableState.FAULT
            if not self._is_on():
                return TableState.DISABLED
            return TableState.MOVING if self._moves() else TableState.AT_REST

    # Hooks ------------------------------------------------------------------------------------------------------------

    def _check_axis(self) -> None:
        """An axis that is not there is not answered for; the queue then says why."""
        self._line.take_errors()
        try:
            units = self._line.ask(ASK_UNITS, parse_number)
        except NoAnswerError as err:
            if errors := self._line.take_errors():
                raise InstrumentError(
                    f"{self._name}: asked for axis {self._axis}, it reports {listed(errors)}; check the axis"
                ) from err
            raise
        if units != DEGREES:
            raise InstrumentError(
                f"{self._name}: axis {self._axis} counts in units {units:g}, expected {DEGREES}, degrees;"
                " set its units at the controller"
            )

    def _stop(self) -> None:
        self._turns = 0
        self._line.tell(STOP)

    def _come_to_rest(self) -> None:
        if not self._moves():
            return
        self._stop()
        if not wait_until(self._clock, lambda: not self._moves(), self._limits.longest_stop_s()):
            raise InstrumentError(
                f"{self._name}: it was told to stop before its next motion, and still moves, at"
                f" {self._rate_dps():.3f} deg/s; look at the controller"
            )

    def _moves(self) -> bool:
        return not self._at_rest() or abs(self._rate_dps()) > self._rest_rate_dps

    def _is_on(self) -> bool:
        return self._line.ask(ASK_ON, parse_flag)

    def _at_rest(self) -> bool:
        """Whether the controller holds its last motion for done."""
        return self._line.ask(ASK_AT_REST, parse_flag)

    def _angle_deg(self) -> float:
        return self._sign * self._line.ask(ASK_ANGLE, parse_number)

    def _rate_dps(self) -> float:
        return self._sign * self._line.ask(ASK_RATE, parse_number) + 0.0  # which makes 0 of -0

    def _confirm(self, what: str) -> None:
        """The motor is on, and nothing has tripped meanwhile."""
        self._look_for_faults(f"{what} was asked for")
        if not self._is_on():
            raise InstrumentError(f"{self._name}: {what} was asked for, and its motor is off: enable the table first")

    def _fail_on_fault(self, what: str) -> None:
        if self._faults:
            raise InstrumentError(
                f"{self._name}: {what}: in fault: {', '.join(self._faults)}; remove the cause, then enable the table"
                " again"
            )

    def _look_for_faults(self, what: str) -> None:
        self._found_faults()
        self._fail_on_fault(what)

    def _found_faults(self) -> bool:
        self._line.take_errors()
        if self._turns and self._at_rest() and not self._line.take_errors():
            self._turns = 0
            self._faults.append("it turned, and has come to rest by itself without an error")
        return bool(self._faults)

    def _meet_fault(self, fault: Error) -> None:
        """Remember it. Whatever the controller is set up to do at one, no motion goes on in a fault."""
        if str(fault) not in self._faults:
            self._faults.append(str(fault))
            self._turns = 0
            self._line.say(STOP)


Driver = Esp301
