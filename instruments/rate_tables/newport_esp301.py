"""Rotary stage on a Newport ESP301 controller, by its commands on a serial line. Not tried on hardware.

Source: published driver code, see `protocols.esp301`. The axis must count in degrees. The line is 19200 baud, 8N1, as
on an ESP301; an ESP302 also answers at TCP port 5001. Consequences of the sources:

- Only queries are answered, so the queue of errors is emptied after every command, and settings are read back.
- A rate is `MV+` or `MV-` at the velocity `VA`. Another rate in the same direction is a new `VA`. Before the other
  direction, and before an angle, a moving table is brought to rest, and the call returns after that. `WS` would make
  the controller wait by itself, but it would then not accept `ST` either.
- A fault appears only once, in the queue. So the driver stores it until the table is enabled again, and stops the table
  regardless of the controller's settings. An error whose code was lost on the line counts as a fault; so does a table
  that should turn and has come to rest.
- An ESP300 sent an unsolicited error before an answer; such a line is ignored, since the queue contains it too.
- Acceleration and deceleration are programmed. The driver keeps the limit on the rate and refuses higher rates; a
  software limit of the angle (`SL`, `SR`), if set, causes a fault when a turning table reaches it.
- After power-up the axis counts from its present angle until it is homed (`1OR`), and no query shows which: `home`
  it if angles matter. Rates need no home.
- No public source describes a sinusoid: `oscillate` is refused. Nor does one name a query for the acceleration: it is
  derived from successive rates.

Fault handling: a query without an answer, or with an unreadable one, is repeated once on a reopened line. A command
that is lost on the line is detected by reading back and raises `InstrumentError`; so does every error in the queue. An
emergency stop, a following error and a velocity trip make `state` FAULT, a restart makes it DISABLED, and nothing moves
until the table is enabled again.

Use `clockwise=True` if the stage counts clockwise from above: no source states it, compare with the gyro.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TypeVar

from benchctl_instruments.errors import InstrumentError, LinkError
from benchctl_instruments.interfaces import Clock, Identity, TableLimits, TableState
from benchctl_instruments.links.lines import LineDialogue, Manners, NoAnswerError
from benchctl_instruments.links.serial_port import ByteLink, byte_link
from benchctl_instruments.links.tcp import Reconnect
from benchctl_instruments.links.wirelog import WireLog, note_recovered
from benchctl_instruments.protocols.esp301 import (
    ANSWER_END,
    DEGREES,
    SENT_END,
    Error,
    held_an_error,
    is_unasked,
    parse_error,
    parse_flag,
)
from benchctl_instruments.protocols.lines import MOST_SHOWN, parse_number
from benchctl_instruments.rate_tables.constant_rate_table import (
    LEAST,
    AxisDialogue,
    ConstantRateTable,
    check_finite,
    short_way_deg,
)
from benchctl_instruments.recognition import ByLine

Parsed = TypeVar("Parsed")

ASK_ERROR = "TE?"
MOST_ERRORS = 20  # more than the queue can hold


class Esp301Dialogue(AxisDialogue):
    """An `AxisDialogue` in which only queries are answered.

    The queue of errors is therefore emptied after each command, and settings are read back. A query removes an error
    from the queue, and its code may be lost on the line:

    | answer to `TE?`                     | handling                                                             |
    |-------------------------------------|----------------------------------------------------------------------|
    | a 0 with junk                       | queried a second time                                                |
    | unreadable, but not a 0             | a fault, "an error whose code was lost on the line"; queried again   |
    | none in time                        | queried again; a possibly lost error is reported                     |

    Parameters
    ----------
    link
        The link; the dialogue opens and closes it.
    axis
        The controller's number of the axis.
    timeout_s
        Timeout of a complete answer; wall time.
    on_fault
        Called with each fault from the queue.
    """

    def __init__(
        self, link: ByteLink, *, axis: int, timeout_s: float, clock: Clock, on_fault: Callable[[Error], None]
    ) -> None:
        manners = Manners(sent_end=SENT_END, answer_end=ANSWER_END, timeout_s=timeout_s, commands_answered=False)
        self._counting = _CountingLine("rate table", link, manners=manners, clock=clock)
        super().__init__(self._counting, axis=axis)
        self._on_fault = on_fault

    def say(self, command: str) -> None:
        """Send a command without any query."""
        self._line.tell(self._text(command))

    def tell(self, command: str, *values: float) -> None:
        """Send a command, its `{}` filled with values; raises `InstrumentError` if it causes an error."""
        text = self._text(command, *values)
        self._line.tell(text)
        if errors := self.take_errors():
            raise InstrumentError(
                f"{self.who}: sent {text!r}, it reports {listed(errors)}; remove the cause, then enable the table again"
            )

    def write(self, setting: str, value: float) -> None:
        """Set a value and read it back."""
        self.tell(f"{setting}{{}}", value)
        actual = self.ask(f"{setting}?", parse_number)
        if not math.isclose(actual, value, rel_tol=1e-3, abs_tol=1e-3):
            raise InstrumentError(
                f"{self.who}: {self._text(setting)} should be {value:g}, it was not refused and reads back"
                f" {actual:g}; check the controller's own limits, and that nothing else commands it"
            )

    def take_errors(self) -> list[Error]:
        """Empty the queue and return its errors."""
        errors: list[Error] = []
        for error in self._queued():
            errors.append(error)
            if error.fault:
                self._on_fault(error)
            if len(errors) > MOST_ERRORS:
                raise InstrumentError(
                    f"{self.who}: its queue of errors does not come to an end: {listed(errors)}; switch the controller"
                    " off and on"
                )
        return errors

    def _queued(self) -> Iterator[Error]:
        """Yield the errors in the queue until it is empty."""
        while True:
            failures = self._counting.failures
            answer = self._line.ask(ASK_ERROR, skip=is_unasked)
            try:
                error = parse_error(answer)
            except InstrumentError as err:
                if held_an_error(answer):
                    yield Error(code=None)
                error = self._ask_once(ASK_ERROR, parse_error)
                note_recovered(f"{self.who}: sent {ASK_ERROR!r}, {err}")
            if self._counting.failures > failures:
                note_recovered(f"{self.who}: sent {ASK_ERROR!r} twice", "an error may have been lost on the line")
            if error is None:
                return
            yield error

    def _ask_once(self, text: str, parse: Callable[[str], Parsed]) -> Parsed:
        answer = self._line.ask(text, skip=is_unasked)
        try:
            return parse(answer)
        except InstrumentError as err:
            raise InstrumentError(f"{self.who}: sent {text!r}, {err}; check that the address is an ESP301's") from err


class _CountingLine(LineDialogue):
    """Counts failures, including recovered ones: a lost answer may have removed an error from the queue."""

    failures = 0

    def _once(self, text: str, data: bytes, receive: Callable[[], str] | None) -> str:
        try:
            return super()._once(text, data, receive)
        except LinkError:
            self.failures += 1
            raise


def listed(errors: list[Error]) -> str:
    """Return errors in words, oldest first."""
    return ", ".join(map(str, errors))


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
HOME, HOME_VELOCITY = "{axis}OR1", "{axis}OH"  # to the home switch and the index; deg/s
ASK_HOME_ANGLE = "{axis}DH?"  # deg, the angle there
RAMPS = ("{axis}AC", "{axis}AG")  # acceleration, deceleration [deg/s²]

NEAR_DEG = 0.1  # a table at rest this near to an angle has reached it


def _recognised(version: str) -> str:
    """Describe the controller from the answer to `VE?`; raises `InstrumentError` if it is no ESP30x."""
    if "ESP" not in version.upper():
        raise InstrumentError(f"sent {ASK_VERSION!r}, expected ESP301 and a version, got {version[:MOST_SHOWN]!r}")
    return version


class Esp301(ConstantRateTable[Esp301Dialogue]):
    """One axis of an ESP301; a `benchctl_instruments.interfaces.RateTable`. Thread-safe.

    Parameters
    ----------
    address
        `serial://DEVICE?baud=19200`, `socket://HOST:PORT`, or `tcp://HOST:5001` of an ESP302.
    axis
        The controller's number of the axis, from 1.
    clockwise
        Whether the controller counts clockwise from above.
    timeout_s
        Timeout of a complete answer; wall time.
    rest_rate_dps
        Up to this rate the table counts as at rest; also the largest error of a measured rate.
    """

    recognition = (ByLine(names=("ESP30",), query=ASK_VERSION, read=_recognised, sent_end=SENT_END),)

    _controller = "ESP301"
    _ask_angle = ASK_ANGLE
    _ask_rate = ASK_RATE

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
        line = Esp301Dialogue(
            byte_link(address, reconnect=reconnect, wire_log=wire_log),
            axis=axis,
            timeout_s=timeout_s,
            clock=clock,
            on_fault=self._meet_fault,
        )
        super().__init__(line, clock=clock, clockwise=clockwise, rest_rate_dps=rest_rate_dps)
        self._axis = axis
        self._turns = 0  # direction of a running `MV`, as far as the driver knows
        self._faults: list[str] = []  # since the table was enabled, in words

    # Methods of rate tables -------------------------------------------------------------------------------------------

    def identify(self) -> Identity:
        """Return model and firmware from `VE?`."""
        model, _, firmware = self._line.ask(ASK_VERSION, str).partition(" ")
        return Identity(model=model, firmware=firmware.strip())

    def set_limits(self, limits: TableLimits) -> None:
        """Program acceleration and deceleration; store the limit on the rate."""
        with self._lock:
            self._limits.keep(limits)
            for setting in RAMPS:
                self._line.write(setting, limits.acceleration_dps2)

    def enable(self) -> None:
        """Empty the queue of errors, clear stored faults, switch the motor on, hold still."""
        with self._lock:
            self._tell_of_errors()
            self._faults.clear()
            self._line.tell(ON)
            self._stop()
            self._confirm("enabling")

    def go_to_rate(self, rate_dps: float) -> None:
        """Start to turn at a constant rate; returns at once, but first stops the table to change its direction."""
        self._limits.check_rate(rate_dps)
        direction = int(math.copysign(1.0, self._sign * rate_dps))
        with self._lock:
            if abs(rate_dps) < LEAST:
                self._stop()
            elif self._turns == direction and not self._at_rest():
                self._line.write(VELOCITY, abs(rate_dps))
            else:
                self._look_for_faults(f"a rate of {rate_dps:g} deg/s is commanded")
                self._come_to_rest()
                self._line.write(VELOCITY, abs(rate_dps))
                self._line.tell(TURN[direction])
                self._turns = direction
            self._confirm(f"a rate of {rate_dps:g} deg/s")

    def go_to_angle(self, angle_deg: float) -> None:
        """Start to turn to an angle by the shorter way; returns at once, but first stops a moving table."""
        check_finite(self._name, "angle", angle_deg)
        with self._lock:
            rate_dps = self._limits.known().rate_dps
            self._look_for_faults(f"an angle of {angle_deg:g} deg is commanded")
            self._come_to_rest()
            self._line.write(VELOCITY, rate_dps)
            here_deg = self._angle_deg()
            target_deg = here_deg + short_way_deg(here_deg, angle_deg)
            self._line.tell(GO_TO, self._sign * target_deg)
            self._confirm(f"an angle of {angle_deg:g} deg")
            if self._at_rest() and abs(self._angle_deg() - target_deg) > NEAR_DEG:
                raise InstrumentError(
                    f"{self._name}: an angle of {angle_deg:g} deg was commanded and not refused, but the table rests"
                    f" at {self._angle_deg() % 360.0:g} deg; look at the controller"
                )

    def stop(self) -> None:
        """Stop within the deceleration; a table whose motor is off without a fault is left alone."""
        with self._lock:
            self._turns = 0
            for _ in range(2):  # ST is not answered, and one lost line must not leave the table turning
                self._line.say(STOP)
                errors = self._tell_of_errors()
            self._fail_on_fault("a stop was commanded")
            if errors and self._is_on():
                raise InstrumentError(
                    f"{self._name}: a stop was commanded and it reports {listed(errors)}; look at the controller"
                )

    def state(self) -> TableState:
        """Return the state: a fault since the table was enabled first, then disabled, then moving."""
        with self._lock:
            if self._found_faults():
                return TableState.FAULT
            if not self._is_on():
                return TableState.DISABLED
            return TableState.MOVING if self._moves() else TableState.AT_REST

    # Hooks ------------------------------------------------------------------------------------------------------------

    def _check(self) -> None:
        """Check that an ESP30x answers, and that the axis exists and counts in degrees."""
        version = self._line.ask(ASK_VERSION, str)
        try:
            _recognised(version)
        except InstrumentError as err:
            raise InstrumentError(f"{self._name}: {err}; check that the address is an ESP301's") from err
        self._check_axis()

    def _check_axis(self) -> None:
        """Check the axis: queries of a missing axis are not answered, but the queue contains the reason."""
        self._tell_of_errors()
        try:
            units = self._line.ask(ASK_UNITS, parse_number)
        except NoAnswerError as err:
            if errors := self._line.take_errors():
                raise InstrumentError(
                    f"{self._name}: checked axis {self._axis}, it reports {listed(errors)}; check the axis"
                ) from err
            raise
        if units != DEGREES:
            raise InstrumentError(
                f"{self._name}: axis {self._axis} counts in units {units:g}, expected {DEGREES}, degrees;"
                " set its units at the controller"
            )

    def _switch_off(self) -> None:
        self._turns = 0
        self._line.tell(OFF)
        if self._is_on():
            raise InstrumentError(f"{self._name}: its motor was commanded off, and is still on; look at the controller")

    def _begin_to_stop(self) -> None:
        self._stop()

    def _begin_to_home(self, rate_dps: float) -> None:
        self._look_for_faults("homing is commanded")
        self._line.write(HOME_VELOCITY, rate_dps)
        self._line.tell(HOME)

    def _is_homed(self) -> bool:
        if not self._at_rest():
            return False
        self._confirm("homing")
        home_deg = self._sign * self._line.ask(ASK_HOME_ANGLE, parse_number)
        if abs(short_way_deg(home_deg, self._angle_deg())) > NEAR_DEG:
            raise InstrumentError(
                f"{self._name}: homing was commanded and not refused, but the table rests at"
                f" {self._angle_deg() % 360.0:g} deg, expected {home_deg:g}; look at the controller"
            )
        return True

    def _stop(self) -> None:
        self._turns = 0
        self._line.tell(STOP)

    def _moves(self) -> bool:
        return not self._at_rest() or abs(self._rate_dps()) > self._rest_rate_dps

    def _is_on(self) -> bool:
        return self._line.ask(ASK_ON, parse_flag)

    def _at_rest(self) -> bool:
        """Return whether the controller reports its last motion as done."""
        return self._line.ask(ASK_AT_REST, parse_flag)

    def _confirm(self, what: str) -> None:
        """Check that the motor is on and nothing has tripped."""
        self._look_for_faults(f"{what} was commanded")
        if not self._is_on():
            raise InstrumentError(f"{self._name}: {what} was commanded, and its motor is off; enable the table first")

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
        self._tell_of_errors()
        if self._turns and self._at_rest() and not self._line.take_errors():
            self._turns = 0
            self._faults.append("it turned, and has come to rest by itself without an error")
        return bool(self._faults)

    def _tell_of_errors(self) -> list[Error]:
        """Empty the queue when no command can be the cause: store faults, report other errors."""
        errors = self._line.take_errors()
        if others := [error for error in errors if not error.fault]:
            note_recovered(f"{self._name}: it reports {listed(others)}", "none of that is a fault")
        return errors

    def _meet_fault(self, fault: Error) -> None:
        """Store a fault and stop any motion, regardless of the controller's settings."""
        if str(fault) not in self._faults:
            self._faults.append(str(fault))
            self._turns = 0
            self._line.say(STOP)


Driver = Esp301
