"""Rotary stage on an Aerotech Ensemble controller, by its ASCII interface over TCP. Not tried on hardware.

Source: published driver code, see `protocols.ensemble`. The axis must count in degrees, and the ASCII interface must be
switched on as a TCP server; the port as delivered is 8000. Consequences of the sources:

- A rate is a FREERUN, an angle a LINEAR by an increment, which takes the shorter way for any turn count of the axis.
  They cannot follow each other in motion: the table is brought to rest between them before the call returns.
- After power-up the axis is not homed, as its status shows: rates need no home, an angle is refused until the axis is
  homed. `HOME` is answered at its end, and nothing could stop it meanwhile; so `home` runs HomeAsync.bcx, as EPICS'
  motorAerotech does, which must be on the controller.
- Every stop is an ABORT: it ends both motions; its deceleration is a parameter that can be read back. The acceleration
  of a FREERUN is a RAMP RATE, which cannot.
- A bare `%` can precede the answer to a query and is ignored. Since one could also precede a refusal, acknowledgements
  are not trusted: after every command the status or the parameter is queried.
- The controller has no query for a limit on the rate: the driver keeps it and refuses higher rates.
- No public source describes a sinusoid: `oscillate` is refused. Nor does one name a query for the acceleration: it is
  derived from successive rates.

Fault handling: a request without an answer, or with an unreadable one, is repeated once on a new connection, except a
move by an angle and the acknowledgement of faults. A refused command raises `InstrumentError` with the faults that the
drive reports. An emergency stop, a position error and a velocity trip make `state` FAULT, a restart makes it DISABLED,
and nothing moves until the table is enabled again.

The manufacturer calls the positive end of travel the clockwise one, so a positive rate of the controller is assumed to
be clockwise from above. Use `clockwise=False` if the stage is mounted or set up otherwise: compare with the gyro before
trusting either.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.interfaces import Clock, Identity, TableLimits, TableState
from benchctl_instruments.links.lines import LineDialogue, Manners
from benchctl_instruments.links.serial_port import ByteLink, byte_link
from benchctl_instruments.links.tcp import Reconnect
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.protocols.ensemble import (
    ABORT_DECELERATION,
    END,
    HOME_RAMP,
    HOME_SPEED,
    PLANE_MOVES,
    AxisStatus,
    Outcome,
    fault_names,
    is_bare,
    is_reply,
    parse_bits,
    parse_reply,
)
from benchctl_instruments.protocols.lines import MOST_SHOWN, parse_number
from benchctl_instruments.rate_tables.constant_rate_table import (
    LEAST,
    AxisDialogue,
    ConstantRateTable,
    check_finite,
    short_way_deg,
    wait_until,
)
from benchctl_instruments.recognition import ByLine

Parsed = TypeVar("Parsed")


class EnsembleDialogue(AxisDialogue):
    """An `AxisDialogue` in which every line is answered.

    Commands are repeated too, since they set a value and not a change, except those sent with `once`.

    Parameters
    ----------
    link
        The link; the dialogue opens and closes it.
    axis
        The controller's number of the axis.
    timeout_s
        Timeout of a connection and of a reply; wall time.
    explain
        Called after a refusal; returns the reason in words.
    """

    def __init__(
        self, link: ByteLink, *, axis: int, timeout_s: float, clock: Clock, explain: Callable[[], str]
    ) -> None:
        manners = Manners(sent_end=END, answer_end=END, timeout_s=timeout_s)
        super().__init__(LineDialogue("rate table", link, manners=manners, clock=clock), axis=axis)
        self._explain = explain

    def say(self, command: str) -> None:
        """Send a command and ignore its outcome."""
        self._line.tell(self._text(command), repeatable=True)

    def tell(self, command: str, *values: float, once: bool = False) -> None:
        """Send a command, its `{}` filled with values; it must be acknowledged."""
        text = self._text(command, *values)
        line = self._line.tell(text, repeatable=not once)
        if not (once or is_reply(line)):
            line = self._line.tell(text)
        try:
            outcome = parse_reply(line).outcome
        except InstrumentError as err:
            raise InstrumentError(f"{self.who}: sent {text!r}, {err}; check that the address is an Ensemble's") from err
        if outcome is not Outcome.DONE:
            raise InstrumentError(
                f"{self.who}: sent {text!r}, expected %, got {line[:MOST_SHOWN]!r}; {self._reason(outcome)}"
            )

    def _ask_once(self, text: str, parse: Callable[[str], Parsed]) -> Parsed:
        line = self._line.ask(text, skip=is_bare)
        try:
            reply = parse_reply(line)
            if reply.outcome is not Outcome.DONE:
                raise InstrumentError(f"expected % and data, got {line[:MOST_SHOWN]!r}")
            return parse(reply.data)
        except InstrumentError as err:
            raise InstrumentError(
                f"{self.who}: sent {text!r}, {err}; check that the address is an Ensemble's, and the axis"
            ) from err

    def _reason(self, outcome: Outcome) -> str:
        if outcome is Outcome.NOT_UNDERSTOOD:
            return "it does not understand that; check the axis, the limits and the controller's version"
        if outcome is Outcome.NOT_IN_TIME:
            return "it did not finish in time; look at the controller, and begin again by enabling the table"
        return self._explain()


ASK_STATUS = "AXISSTATUS(@{axis})"
ASK_FAULT = "AXISFAULT(@{axis})"
ASK_PLANE = "PLANESTATUS(0)"
ASK_ANGLE = "PFBKPROG(@{axis})"  # deg
ASK_RATE = "VFBK(@{axis})"  # deg/s
ASK_ABORT_DECELERATION = f"GETPARM(@{{axis}}, {ABORT_DECELERATION})"

ENABLE = "ENABLE @{axis}"
DISABLE = "DISABLE @{axis}"
ACKNOWLEDGE_FAULTS = "FAULTACK @{axis}"
RAMPS_ARE_RATES = "RAMP MODE @{axis} RATE"
ACCELERATION = ("RAMP RATE @{axis} {}", "RAMP RATE {}", f"SETPARM @{{axis}}, {ABORT_DECELERATION}, {{}}")
TURN = "FREERUN @{axis} {}"
BEFORE_A_MOVE = ("WAIT MODE NOWAIT", "INC")  # the reply does not wait for the end of the move; moves are relative
MOVE_BY = "LINEAR @{axis} {} F{}"
ABORT = "ABORT @{axis}"

HOMING = ((HOME_SPEED, "deg/s"), (HOME_RAMP, "deg/s²"))
RUN_HOMING = ("IGLOBAL(32) = 1", "IGLOBAL(33) = {axis}", 'PROGRAM RUN 5, "HomeAsync.bcx"')

CONFIRM_S = 0.5  # bench time in which the status must follow a command


def _recognised(line: str) -> str:
    """Describe the controller from the answer to `AXISSTATUS(@0)`: `%` and a word of 32 bits."""
    reply = parse_reply(line)
    if reply.outcome is not Outcome.DONE:
        raise InstrumentError(f"expected % and data, got {line[:MOST_SHOWN]!r}")
    status = AxisStatus(parse_bits(reply.data))
    return f"Aerotech's ASCII interface; axis 0 is {'enabled' if AxisStatus.ENABLED in status else 'disabled'}"


class Ensemble(ConstantRateTable[EnsembleDialogue]):
    """One axis of an Ensemble; a `benchctl_instruments.interfaces.RateTable`. Thread-safe.

    Parameters
    ----------
    address
        `tcp://HOST:PORT`.
    axis
        The controller's number of the axis, from 0.
    clockwise
        Whether the controller counts clockwise from above.
    timeout_s
        Timeout of a connection and of a reply; wall time.
    rest_rate_dps
        Up to this rate the table counts as at rest; also the largest error of a measured rate.
    """

    recognition = (ByLine(query=ASK_STATUS.format(axis=0), read=_recognised, sent_end=END),)

    _controller = "Ensemble's ASCII interface"
    _ask_angle = ASK_ANGLE
    _ask_rate = ASK_RATE

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        axis: int = 0,
        clockwise: bool = True,
        timeout_s: float = 2.0,
        rest_rate_dps: float = 0.05,
        reconnect: Reconnect | None = None,
        wire_log: WireLog | None = None,
    ) -> None:
        line = EnsembleDialogue(
            byte_link(address, reconnect=reconnect, wire_log=wire_log),
            axis=axis,
            timeout_s=timeout_s,
            clock=clock,
            explain=self._explained_refusal,
        )
        super().__init__(line, clock=clock, clockwise=clockwise, rest_rate_dps=rest_rate_dps)

    def identify(self) -> Identity:
        """Return an empty identity: no public source describes a query for it."""
        return Identity()

    def set_limits(self, limits: TableLimits) -> None:
        """Program the acceleration of rates, angles and ABORT; store the limit on the rate."""
        with self._lock:
            self._limits.keep(limits)
            self._line.tell(RAMPS_ARE_RATES)
            for command in ACCELERATION:
                self._line.tell(command, limits.acceleration_dps2)
            actual = self._line.ask(ASK_ABORT_DECELERATION, parse_number)
            if not math.isclose(actual, limits.acceleration_dps2, rel_tol=1e-3):
                raise InstrumentError(
                    f"{self._name}: the deceleration of ABORT should be {limits.acceleration_dps2:g} deg/s², it was"
                    f" acknowledged and reads back {actual:g}; check the controller's parameters"
                )

    def enable(self) -> None:
        """Acknowledge faults, enable the axis, hold still."""
        with self._lock:
            if self._found_faults():
                self._line.tell(ACKNOWLEDGE_FAULTS, once=True)
                self._fail_on_fault("its faults were acknowledged and are back")
            self._line.tell(ENABLE)
            self._stop("enabling")

    def go_to_rate(self, rate_dps: float) -> None:
        """Start to turn at a constant rate; returns at once, but first stops a table that moves to an angle."""
        self._limits.check_rate(rate_dps)
        with self._lock:
            if abs(rate_dps) < LEAST:
                self._stop("a rate of 0 deg/s")
                return
            self._fail_on_fault(f"a rate of {rate_dps:g} deg/s is commanded")
            if self._goes_to_angle():
                self._come_to_rest()
            self._line.tell(TURN, self._sign * rate_dps)
            self._confirm(f"a rate of {rate_dps:g} deg/s", AxisStatus.ENABLED | AxisStatus.MOVE_ACTIVE)

    def go_to_angle(self, angle_deg: float) -> None:
        """Start to turn to an angle by the shorter way; returns at once, but first stops a moving table."""
        check_finite(self._name, "angle", angle_deg)
        with self._lock:
            rate_dps = self._limits.known().rate_dps
            self._fail_on_fault(f"an angle of {angle_deg:g} deg is commanded")
            if not self._status() & AxisStatus.HOMED:
                raise InstrumentError(
                    f"{self._name}: an angle of {angle_deg:g} deg is commanded, and the axis is not homed: its angles"
                    " count from where it was switched on; home it (the step Home, or HOME at the controller)"
                )
            self._come_to_rest()
            by_deg = short_way_deg(self._angle_deg(), angle_deg)
            if abs(by_deg) >= LEAST:
                for command in BEFORE_A_MOVE:
                    self._line.tell(command)
                self._line.tell(MOVE_BY, self._sign * by_deg, rate_dps, once=True)
            self._confirm(f"an angle of {angle_deg:g} deg", AxisStatus.ENABLED)

    def stop(self) -> None:
        """Stop with the deceleration of ABORT; a disabled table without a fault is left alone."""
        with self._lock:
            refusal: InstrumentError | None = None
            try:
                self._line.tell(ABORT)  # before any query
            except InstrumentError as err:
                refusal = err
            self._fail_on_fault("a stop was commanded")
            if refusal is not None and self._status() & AxisStatus.ENABLED:
                raise refusal

    def state(self) -> TableState:
        """Return the state: fault first, then disabled, then moving."""
        with self._lock:
            if self._found_faults():
                return TableState.FAULT
            if not self._status() & AxisStatus.ENABLED:
                return TableState.DISABLED
            return TableState.MOVING if self._moves() else TableState.AT_REST

    # Hooks ------------------------------------------------------------------------------------------------------------

    def _check(self) -> None:
        """Query the status: a controller that answers it is accepted as an Ensemble."""
        self._status()

    def _switch_off(self) -> None:
        self._line.tell(DISABLE)
        if not wait_until(self._clock, lambda: not self._status() & AxisStatus.ENABLED, CONFIRM_S):
            raise InstrumentError(
                f"{self._name}: disabling was commanded, and the axis is still enabled; look at the controller"
            )

    def _begin_to_stop(self) -> None:
        self._stop("a stop before the next motion")

    def _begin_to_home(self, rate_dps: float) -> None:
        self._fail_on_fault("homing is commanded")
        for (number, unit), value in zip(HOMING, (rate_dps, self._limits.known().acceleration_dps2), strict=True):
            self._line.tell(f"SETPARM @{{axis}}, {number}, {{}}", value)
            actual = self._line.ask(f"GETPARM(@{{axis}}, {number})", parse_number)
            if not math.isclose(actual, value, rel_tol=1e-3):
                raise InstrumentError(
                    f"{self._name}: parameter {number} of homing should be {value:g} {unit}, it was acknowledged and"
                    f" reads back {actual:g}; check the controller's parameters"
                )
        *globals_, run = RUN_HOMING
        for command in globals_:
            self._line.tell(command)
        try:
            self._line.tell(run, once=True)
        except InstrumentError as err:
            raise InstrumentError(f"{err}; copy HomeAsync.bcx to the controller, or home it there (HOME)") from err

    def _is_homed(self) -> bool:
        self._fail_on_fault("homing was commanded")
        status = self._status()
        return bool(status & AxisStatus.HOMED) and not status & AxisStatus.HOMING and not self._moves()

    def _stop(self, what: str) -> None:
        self._line.tell(ABORT)
        self._confirm(what, AxisStatus.ENABLED)

    def _moves(self) -> bool:
        return (
            self._goes_to_angle()
            or bool(self._status() & AxisStatus.MOVE_ACTIVE)
            or abs(self._rate_dps()) > self._rest_rate_dps
        )

    def _goes_to_angle(self) -> bool:
        return bool(self._line.ask(ASK_PLANE, parse_bits) & PLANE_MOVES)

    def _status(self) -> int:
        return self._line.ask(ASK_STATUS, parse_bits)

    def _found_faults(self) -> int:
        """Return the word of faults; in a fault any motion is aborted, regardless of the controller's settings."""
        word = self._line.ask(ASK_FAULT, parse_bits)
        if word and self._status() & AxisStatus.ENABLED:
            self._line.say(ABORT)
        return word

    def _confirm(self, what: str, wanted: AxisStatus) -> None:
        """Wait for bits of the status, and check that nothing has tripped."""
        shown = wait_until(self._clock, lambda: self._status() & wanted == wanted, CONFIRM_S)
        self._fail_on_fault(f"{what} was commanded")
        if not shown:
            raise InstrumentError(
                f"{self._name}: {what} was commanded and acknowledged, its status should show {wanted!r} and is"
                f" 0x{self._status():08X}; check that nothing else commands the axis"
            )

    def _fail_on_fault(self, what: str) -> None:
        if word := self._found_faults():
            raise InstrumentError(f"{self._name}: {what}: {_explained(word)}")

    def _explained_refusal(self) -> str:
        word = self._line.ask(ASK_FAULT, parse_bits)
        return _explained(word) if word else "no fault is reported; check that the axis is enabled and at rest"


def _explained(word: int) -> str:
    return (
        f"fault 0x{word:X} ({', '.join(fault_names(word))}); remove the cause, then acknowledge it by enabling the"
        " table again"
    )


Driver = Ensemble
