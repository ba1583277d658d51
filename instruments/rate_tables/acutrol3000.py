"""Rate table controller Acutronic ACUTROL3000, by ACL over TCP or GPIB. Not tried on hardware.

Source: published driver code of three laboratories, see `protocols.acl`. The port depends on the site: 9888 and 9878
are both in use, so the address states it. On GPIB (`visa://GPIB0::7::INSTR`) a command has no reply; the status byte is
read after it, and a bit beside those of a fault of the interlock (65) counts as a refusal. That is an assumption: the
sources only show 65. Consequences of these sources:

- A mode starts with its last demand, as fast as the limits permit. A demand is therefore always loaded before its mode
  is entered, never after.
- Only the relative demand is known to take the shorter way; `go_to_angle` uses it.
- The oscillator's amplitude is an angle: the rate's amplitude / (2π f).
- Only the words `Fault`, `Rate` and `Position` are known as answers. An interlock that answers neither `Fault` nor
  `Open` counts as closed, and modes are recognised by the beginning of their name.

Every write is read back. That `:dem:pos?` answers with the demand is known; that `:dem:rate?` and `:dem:osc?` do so is
inferred from it. With `demand_queries=False` the three are not used: a demand is then confirmed by its acknowledgement
and by the mode.

Fault handling: link faults as in `AxisDialogue`; a move by an angle and the reset of the interlock are never repeated.
In addition:

| fault                                          | handling                                                         |
|------------------------------------------------|------------------------------------------------------------------|
| a refusal                                      | `InstrumentError`, with interlock, mode and status byte          |
| an opened interlock, a velocity trip, a        | `state` is FAULT; the next demand raises `InstrumentError`;      |
| following error                                | only `enable` resets them                                        |
| the controller restarts                        | `state` is DISABLED; the next demand raises `InstrumentError`    |
| an acknowledged demand that is not kept        | `InstrumentError`: every demand is read back                     |
| a rate that is stuck                           | not handled: a campaign that waits for its rate detects it       |
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import TypeVar

from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Clock, Identity, Instrument, TableLimits, TableReading, TableState
from benchctl_instruments.links.lines import LineDialogue, Manners
from benchctl_instruments.links.serial_port import ByteLink, byte_link
from benchctl_instruments.links.tcp import Reconnect
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.protocols.acl import AROUND, HEADER_LENGTH, OK, reply_data
from benchctl_instruments.protocols.lines import MOST_SHOWN, UnreadableError, parse_number
from benchctl_instruments.rate_tables.constant_rate_table import AxisDialogue
from benchctl_instruments.recognition import ByLine

Parsed = TypeVar("Parsed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Numbers that are written by one command and read back by one query.

    `{axis}` and `{}` are placeholders of the axis and the numbers. `tolerance` is the permitted deviation of an answer,
    in the units of `name`; deviations by multiples of `turn` are ignored.
    """

    name: str
    write: str
    ask: str
    tolerance: float
    turn: float = math.inf


class AclDialogue(AxisDialogue):
    """An `AxisDialogue` in which every line is answered; on GPIB only queries are.

    Commands are repeated too, since they set a value and not a change, except those sent with `once`. After an
    unreadable reply the connection is closed, as it is after a missing one. ACL has no checksum: junk that consists of
    digits, next to or in a number, is not detected.

    Parameters
    ----------
    link
        The link; the dialogue opens and closes it.
    axis
        The controller's number of the axis.
    timeout_s
        Timeout of a connection and of a complete reply; wall time.
    terminator
        The bytes that end a reply.
    explain
        Called after a refusal; returns the reason in words.
    """

    def __init__(
        self,
        link: ByteLink,
        *,
        axis: int,
        timeout_s: float,
        clock: Clock,
        terminator: bytes,
        explain: Callable[[], str],
    ) -> None:
        self._on_gpib = link.address.is_gpib
        manners = Manners(
            answer_end=terminator,
            timeout_s=timeout_s,
            commands_answered=not self._on_gpib,
            trimmed=AROUND,
            advice="check that the controller is in remote mode and that nobody else holds its link",
        )
        super().__init__(LineDialogue("rate table", link, manners=manners, clock=clock), axis=axis)
        self._explain = explain
        self._lock = threading.RLock()  # on GPIB a command and its status belong together

    def numbers(self, query: str, count: int, parted_by: str = ",") -> tuple[float, ...]:
        """Return the finite numbers in the reply to a query, exactly `count` of them."""
        data = self.ask(query, str)
        try:
            numbers = tuple(parse_number(word) for word in data.split(parted_by))
        except UnreadableError:
            numbers = ()
        if len(numbers) != count:
            wanted = f"{count} numbers parted by {parted_by!r}" if count > 1 else "a number"
            raise InstrumentError(
                f"{self.who}: asked {self._text(query)!r}, expected {wanted}, got {data[:MOST_SHOWN]!r};"
                " check that the controller speaks the dialect of the ACUTROL3000"
            )
        return numbers

    def tell(self, command: str, *values: float, once: bool = False) -> None:
        """Send a command, which must be acknowledged; with `once` it is not repeated without an acknowledgement."""
        text = self._text(command, *values)
        with self._lock:
            if self._on_gpib:
                self._line.tell(text, repeatable=not once)
                data = self.ask(ASK_STATUS, _outcome)
            elif once:
                data = self._parsed(text, self._line.tell(text), str)
            else:
                data = self.ask(text, str)
        if data.upper() != OK:
            raise InstrumentError(
                f"{self.who}: sent {text!r}, expected {OK}, got {data[:MOST_SHOWN]!r}; {self._explain()}"
            )

    def write(self, setting: Setting, *values: float) -> None:
        """Send numbers and read them back."""
        self.tell(setting.write, *values)
        self.expect(setting, *values)

    def expect(self, setting: Setting, *wanted: float) -> None:
        """Read numbers back and compare them with the wanted ones."""
        actual = self.numbers(setting.ask, len(wanted))
        errors = (math.remainder(a - w, setting.turn) for a, w in zip(actual, wanted, strict=True))
        if any(abs(error) > setting.tolerance for error in errors):
            raise InstrumentError(
                f"{self.who}: {setting.name} should be {_listed(wanted)}, it acknowledged and reads back"
                f" {_listed(actual)}; check the controller's limits, and that nothing else commands it"
            )

    def _ask_once(self, text: str, parse: Callable[[str], Parsed]) -> Parsed:
        with self._lock:
            return self._parsed(text, self._line.ask(text), parse)

    def _parsed(self, text: str, line: str, parse: Callable[[str], Parsed]) -> Parsed:
        try:
            return parse(reply_data(line, header_length=0 if self._on_gpib else HEADER_LENGTH))
        except InstrumentError as err:
            self._line.give_up("given up: not ACL")
            raise InstrumentError(
                f"{self.who}: sent {text!r}, {err}; check that the address is an ACUTROL3000's"
            ) from err


def _outcome(status: str) -> str:
    """Return the reply that a command on GPIB would have had over TCP, by the status byte after it."""
    refused = not status.isdecimal() or int(status) & ~FAULT_STATUS
    return f"status byte {status}" if refused else OK


def _listed(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:.6g}" for value in values)


class Mode(Enum):
    """Modes of the axis; the values are the possible beginnings of their names in answers to `:mode?`."""

    OFF = ("off",)
    POSITION = ("pos",)
    RATE = ("rate", "rel")
    ABSOLUTE_RATE = ("arate", "abs")
    SYNTHESIZER = ("synt",)
    ABORT = ("abort",)


RATE_DEMAND = Setting(name="rate demand [deg/s]", write=":dem:rate {axis},{}", ask=":dem:rate? {axis}", tolerance=1e-3)
ANGLE_DEMAND = Setting(
    name="angle demand [deg]", write=":dem:pos {axis},{}", ask=":dem:pos? {axis}", tolerance=1e-3, turn=360.0
)
OSCILLATION = Setting(
    name="oscillation [deg, Hz, deg]", write=":dem:osc {axis},{},{},{}", ask=":dem:osc? {axis}", tolerance=1e-3
)
RATE_LIMITS, ACCELERATION_LIMITS = (
    tuple(
        Setting(
            name=f"{name} in {mode} mode",
            write=f"{key} {mode},{{axis}},{{}}",
            ask=f"{key}? {mode},{{axis}}",
            tolerance=1e-2,
        )
        for mode in ("pos", "rate", "synt")  # each has its own limits
    )
    for name, key in (("rate limit [deg/s]", ":lim:rate"), ("acceleration limit [deg/s²]", ":lim:acc"))
)

ASK_MOTION = ":read:pos? {axis};rate? {axis};acc? {axis}"  # deg, deg/s, deg/s²
ASK_MODE = ":mode? {axis}"
ASK_INTERLOCK = ":interlock? {axis}"
ASK_STATUS = "*stb?"
FAULT_STATUS = 65  # the status byte while the interlock is in fault
ASK_IDENTITY = "*idn?"
SET_MODE = {
    Mode.OFF: ":mode:off {axis}",
    Mode.POSITION: ":mode:pos {axis}",
    Mode.RATE: ":mode:rate {axis}",
    Mode.SYNTHESIZER: ":mode:synt {axis}",
}
RESET = ":interlock:reset"
CLOSE_LOOP = ":interlock:close {axis}"
OPEN_LOOP = ":interlock:open {axis}"
MOVE_BY = ":dem:delta {axis},{}"
SLEW = ":con:osc {axis},Enable,{},{},Pos,Lin"  # slew rates of amplitude [deg/s] and frequency [Hz/s]


def _mode_named(name: str) -> Mode:
    """Return the mode of that name, as `:mode?` answers it."""
    for mode in Mode:
        if name.lower().startswith(mode.value):
            return mode
    raise UnreadableError(f"expected the name of a mode such as Rate or Position, got {name[:MOST_SHOWN]!r}")


def _recognised(line: str) -> str:
    """Describe the controller from a reply to `:mode? 1`: a header, then the name of a mode."""
    name = reply_data(line)
    _mode_named(name)
    return f"ACL; axis 1 in mode {name}"


class Acutrol3000(Instrument):
    """One axis of an ACUTROL3000; a `benchctl_instruments.interfaces.RateTable`. Thread-safe.

    Parameters
    ----------
    address
        `tcp://HOST:PORT`, or `visa://GPIB0::7::INSTR` with the controller's address on GPIB.
    axis
        The controller's number of the axis.
    timeout_s
        Timeout of a connection and of a reply; wall time.
    pause_s
        Bench time to wait after a change of mode or interlock.
    rest_rate_dps
        Up to this rate the table counts as at rest.
    rise_cycles
        Number of periods in which an oscillation reaches its amplitude and frequency.
    set_slew
        False leaves the oscillator's slew rates unchanged; one laboratory could not set them.
    demand_queries
        False if the controller does not answer with its demands, see above.
    status_bits
        Names of the bits of the status byte by their numbers, `{"0": "…"}`, for error messages.
    reply_terminator
        The text that ends a reply on this site's link.
    """

    recognition = (
        ByLine(names=("ACUTROL",), query=ASK_MODE.format(axis=1), read=_recognised, schemes=("tcp", "socket")),
    )

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        axis: int = 1,
        timeout_s: float = 2.0,
        pause_s: float = 0.2,
        rest_rate_dps: float = 0.05,
        rise_cycles: float = 2.0,
        set_slew: bool = True,
        demand_queries: bool = True,
        status_bits: Mapping[str, str] | None = None,
        reply_terminator: str = "\n",
        reconnect: Reconnect | None = None,
        wire_log: WireLog | None = None,
    ) -> None:
        self._line = AclDialogue(
            byte_link(address, reconnect=reconnect, wire_log=wire_log),
            axis=axis,
            timeout_s=timeout_s,
            clock=clock,
            terminator=reply_terminator.encode("ascii"),
            explain=lambda: self._fault() or "no fault is reported",
        )
        self._name = self._line.who
        self._clock = clock
        self._pause_s = pause_s
        self._rest_rate_dps = rest_rate_dps
        self._rise_cycles = rise_cycles
        self._set_slew = set_slew
        self._demand_queries = demand_queries
        self._status_bits = {int(bit): name for bit, name in (status_bits or {}).items()}
        self._lock = threading.RLock()  # a method's writes and their confirmation belong together

    # Methods of all instruments ---------------------------------------------------------------------------------------

    def open(self) -> None:
        """Connect; a controller that answers with a mode is accepted as an ACUTROL."""
        self._line.open()
        try:
            self._mode()
        except (LinkError, InstrumentError):
            self._line.close()
            raise

    def close(self) -> None:
        """Close the link; the table continues its motion."""
        self._line.close()

    def identify(self) -> Identity:
        """Return the identity from `*idn?` (manufacturer,model,serial,firmware), empty for other answers."""
        words = [word.strip() for word in self._line.ask(ASK_IDENTITY, str).split(",")]
        if len(words) != 4:
            return Identity()
        return Identity(manufacturer=words[0], model=words[1], serial=words[2], firmware=words[3])

    # Methods of rate tables -------------------------------------------------------------------------------------------

    def set_limits(self, limits: TableLimits) -> None:
        """Program the rate and acceleration limits of the position, rate and synthesizer modes."""
        _positive("rate limit", limits.rate_dps)
        _positive("acceleration limit", limits.acceleration_dps2)
        with self._lock:
            for setting in RATE_LIMITS:
                self._line.write(setting, limits.rate_dps)
            for setting in ACCELERATION_LIMITS:
                self._line.write(setting, limits.acceleration_dps2)

    def enable(self) -> None:
        """Reset the interlock, close the loop, hold still in rate mode."""
        with self._lock:
            self._line.tell(RESET, once=True)  # a second reset would clear faults since the first
            self._pause()
            self._fail_on_fault("the interlock was reset and is in fault again")
            self._line.tell(SET_MODE[Mode.OFF])
            self._line.tell(CLOSE_LOOP)
            self._pause()
            self.go_to_rate(0.0)

    def disable(self) -> None:
        """Switch the mode off, then open the loop; raises `UsageError` while the table moves."""
        with self._lock:
            rate_dps = self.read().rate_dps
            if abs(rate_dps) > self._rest_rate_dps:
                raise UsageError(f"{self._name}: it turns at {rate_dps:.3f} deg/s; stop it before it is disabled")
            self._line.tell(SET_MODE[Mode.OFF])
            self._pause()
            self._line.tell(OPEN_LOOP)
            self._pause()
            state = self.state()
            if state is not TableState.DISABLED:
                raise InstrumentError(
                    f"{self._name}: its loop was told to open, but the table is {state.value}; look at the controller"
                )

    def go_to_rate(self, rate_dps: float) -> None:
        """Start to turn at a constant rate, in rate mode."""
        _finite("rate", rate_dps)
        with self._lock:
            self._demand(RATE_DEMAND, rate_dps)
            self._enter(Mode.RATE)

    def go_to_angle(self, angle_deg: float) -> None:
        """Start to turn to an angle by the shorter way, in position mode, from the present angle."""
        _finite("angle", angle_deg)
        with self._lock:
            here_deg = self.read().angle_deg
            self._demand(ANGLE_DEMAND, here_deg)
            self._enter(Mode.POSITION)
            self._line.tell(MOVE_BY, (angle_deg - here_deg + 180.0) % 360.0 - 180.0, once=True)
            if self._demand_queries:
                self._line.expect(ANGLE_DEMAND, angle_deg)
            self._enter(Mode.POSITION)

    def oscillate(self, amplitude_dps: float, frequency_hz: float) -> None:
        """Start to oscillate about the present angle, in synthesizer mode; it takes `rise_cycles` periods to rise."""
        _positive("amplitude", amplitude_dps)
        _positive("frequency", frequency_hz)
        amplitude_deg = amplitude_dps / (2.0 * math.pi * frequency_hz)
        rise_s = self._rise_cycles / frequency_hz
        with self._lock:
            if self._set_slew:
                self._line.tell(SLEW, amplitude_deg / rise_s, frequency_hz / rise_s)
            self._demand(OSCILLATION, amplitude_deg, frequency_hz, 0.0)
            self._enter(Mode.SYNTHESIZER)

    def stop(self) -> None:
        """Demand a rate of 0 in rate mode; in mode off do nothing, since the controller stops the table by itself."""
        with self._lock:
            if self._mode() is not Mode.OFF:
                self.go_to_rate(0.0)

    def read(self) -> TableReading:
        """Return angle, rate and acceleration from one query."""
        angle_deg, rate_dps, acceleration_dps2 = self._line.numbers(ASK_MOTION, 3, ";")
        return TableReading(angle_deg=angle_deg % 360.0, rate_dps=rate_dps, acceleration_dps2=acceleration_dps2)

    def state(self) -> TableState:
        """Return the state from interlock, mode and rate: fault or abort first, then disabled, then moving."""
        with self._lock:
            interlock, mode = self._line.ask(ASK_INTERLOCK, str).lower(), self._mode()
            if interlock.startswith("fault") or mode is Mode.ABORT:
                return TableState.FAULT
            if interlock.startswith("open") or mode is Mode.OFF:
                return TableState.DISABLED
            return TableState.MOVING if abs(self.read().rate_dps) > self._rest_rate_dps else TableState.AT_REST

    # Hooks ------------------------------------------------------------------------------------------------------------

    def _demand(self, setting: Setting, *values: float) -> None:
        if self._demand_queries:
            self._line.write(setting, *values)
        else:
            self._line.tell(setting.write, *values)

    def _enter(self, mode: Mode) -> None:
        """Enter a mode, or confirm that the table is in it; in both cases check that nothing has tripped."""
        if self._mode() is not mode:
            self._line.tell(SET_MODE[mode])
            self._pause()
        actual = self._mode()
        self._fail_on_fault(f"{mode.name} mode was asked for")
        if actual is not mode:
            raise InstrumentError(
                f"{self._name}: {mode.name} mode was asked for and acknowledged, the table is in {actual.name} mode;"
                " see the controller's front panel"
            )

    def _mode(self) -> Mode:
        return self._line.ask(ASK_MODE, _mode_named)

    def _fail_on_fault(self, what: str) -> None:
        fault = self._fault()
        if fault:
            raise InstrumentError(f"{self._name}: {what}: {fault}")

    def _fault(self) -> str:
        """Return the fault and what to do, in words; empty if neither the interlock nor the mode reports a fault."""
        interlock, mode = self._line.ask(ASK_INTERLOCK, str), self._mode()
        if not interlock.lower().startswith("fault") and mode is not Mode.ABORT:
            return ""
        status = self._line.ask(ASK_STATUS, str)
        bits = [name for bit, name in self._status_bits.items() if status.isdecimal() and int(status) >> bit & 1]
        named = f" ({', '.join(bits)})" if bits else ""
        return (
            f"interlock {interlock}, mode {mode.name}, status byte {status}{named}; remove the cause (emergency stop,"
            " door, velocity trip, following error), then reset the interlock by enabling the table again"
        )

    def _pause(self) -> None:
        self._clock.sleep(self._pause_s)


def _finite(what: str, value: float) -> None:
    if not math.isfinite(value):
        raise UsageError(f"{what} {value}: expected a finite number")


def _positive(what: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise UsageError(f"{what} {value}: expected a finite number above 0")


Driver = Acutrol3000
