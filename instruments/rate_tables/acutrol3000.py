"""Rate table controller Acutronic ACUTROL3000, by ACL over TCP. Not tried on hardware.

Source: published driver code of three laboratories, see `protocols.acl`. The port is a matter of the site:
9888 and 9878 are both in use, so the address says it. What follows from those sources, and is done here:

- A mode starts with whatever was last demanded of it, as fast as the limits allow. So a demand is always loaded before
  its mode is entered, never after.
- Only the relative demand is known to go the short way round; `go_to_angle` uses it.
- The oscillator's amplitude is an angle: the rate's amplitude / (2π f).
- Only the words `Fault`, `Rate` and `Position` are known as answers. An interlock that answers neither `Fault` nor
  `Open` counts as closed, and modes are recognised by the beginning of their name.

Every write is read back. That `:dem:pos?` answers with the demand is known; that `:dem:rate?` and `:dem:osc?` do so is
concluded from it. `demand_queries=False` does without the three: a demand is then confirmed by its acknowledgement and
by the mode.

What it does about faults: those of the link as `AclDialogue` says; neither a move by an angle nor the reset of the
interlock is said twice. Further:

| what goes wrong                                | what is done                                                     |
|------------------------------------------------|------------------------------------------------------------------|
| a refusal                                      | `InstrumentError`, with interlock, mode and status byte          |
| the interlock is opened by hand, a velocity    | `state` is FAULT; the next demand is an `InstrumentError`;       |
| trip, a following error                        | nothing is reset but by `enable`                                 |
| the controller restarts                        | `state` is DISABLED; the next demand is an `InstrumentError`     |
| an acknowledged demand that is not kept        | `InstrumentError`: every demand is read back                     |
| a rate that is stuck                           | nothing: a campaign that waits for its rate finds out            |
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum

from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Clock, Identity, Instrument, TableLimits, TableReading, TableState
from benchctl_instruments.links.tcp import LinkCutError, Reconnect, TcpLink
from benchctl_instruments.links.wirelog import WireLog, note_recovered
from benchctl_instruments.protocols.acl import Reply, ReplyReader, encode
from benchctl_instruments.protocols.lines import MOST_SHOWN, parse_number


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Numbers that are written by one command and read back by one query.

    `{axis}` and `{}` stand for the axis and the numbers. `tolerance` is how far an answer may be off, in the units of
    `name`; an answer that is off by a whole `turn` is not off.
    """

    name: str
    write: str
    ask: str
    tolerance: float
    turn: float = math.inf


class AclDialogue:
    """A dialogue with one axis of a controller; every exchange is safe from several threads.

    | what goes wrong                                   | what is done                                               |
    |---------------------------------------------------|------------------------------------------------------------|
    | no reply, a late one, half of one, a cut link     | asked once more, on a new connection; then `LinkError`     |
    | junk before or in a reply, a reply that is none   | asked once more, on a new connection; `InstrumentError`    |
    | junk behind a reply                               | thrown away                                                |
    | a reply in pieces                                 | put together                                               |
    | the controller restarts                           | connected again; it is then disabled, and says so          |
    | a refusal                                         | `InstrumentError`, with the fault that it reports          |

    A command is said again too, because it states what is to be and not by how much it is to change: all but those
    that are told `once`. After any failure the connection is given up, so that a late reply is never taken for the
    answer to the next question. ACL has no checksum: junk that is digits, beside or in a number, is not found out.

    Parameters
    ----------
    name
        How error messages call the instrument.
    link
        The link; the dialogue opens and closes it.
    axis
        What `{axis}` in commands and queries stands for.
    timeout_s
        How long to wait for a connection, and for a whole reply; wall time.
    terminator
        What ends a reply.
    explain
        Asked after a refusal: why, in words.
    """

    def __init__(
        self,
        name: str,
        link: TcpLink,
        *,
        axis: int,
        timeout_s: float,
        terminator: bytes,
        explain: Callable[[], str],
    ) -> None:
        self._name = name
        self._link = link
        self._axis = axis
        self._timeout_s = timeout_s
        self._terminator = terminator
        self._explain = explain
        self._lock = threading.Lock()

    def open(self) -> None:
        """Connect."""
        try:
            with self._lock:
                self._link.open(self._timeout_s)
        except LinkError as err:
            raise LinkError(f"{self._name}: {self._link.address.left_out(err)}") from err

    def close(self) -> None:
        """Let go of the link once no exchange is under way; safe to call twice, and never raises."""
        with self._lock:
            self._link.close()

    def ask(self, query: str) -> str:
        """What is said in reply to a query."""
        text = query.format(axis=self._axis)
        with self._lock:
            return self._exchange(text).data

    def numbers(self, query: str, count: int, parted_by: str = ",") -> tuple[float, ...]:
        """The finite numbers in reply to a query, exactly `count` of them."""
        said = self.ask(query)
        try:
            numbers = tuple(parse_number(word) for word in said.split(parted_by))
        except InstrumentError:
            numbers = ()
        if len(numbers) != count:
            wanted = f"{count} numbers parted by {parted_by!r}" if count > 1 else "a number"
            raise InstrumentError(
                f"{self._name}: asked {query.format(axis=self._axis)!r}, expected {wanted}, got {said[:MOST_SHOWN]!r};"
                " check that the controller speaks the dialect of the ACUTROL3000"
            )
        return numbers

    def tell(self, command: str, *values: float, once: bool = False) -> None:
        """Send a command; it must be acknowledged. `once`: it is not sent again where no acknowledgement comes."""
        text = command.format(*(f"{value:.6f}" for value in values), axis=self._axis)
        with self._lock:
            reply = self._attempt(text) if once else self._exchange(text)
        if not reply.ok:
            raise InstrumentError(
                f"{self._name}: sent {text!r}, expected OK, got {reply.data[:MOST_SHOWN]!r}; {self._explain()}"
            )

    def write(self, setting: Setting, *values: float) -> None:
        """Send numbers and read them back."""
        self.tell(setting.write, *values)
        self.expect(setting, *values)

    def expect(self, setting: Setting, *wanted: float) -> None:
        """Read numbers back."""
        actual = self.numbers(setting.ask, len(wanted))
        errors = (math.remainder(a - w, setting.turn) for a, w in zip(actual, wanted, strict=True))
        if any(abs(error) > setting.tolerance for error in errors):
            raise InstrumentError(
                f"{self._name}: {setting.name} should be {_listed(wanted)}, it acknowledged and reads back"
                f" {_listed(actual)}; check the controller's limits, and that nothing else commands it"
            )

    def _exchange(self, text: str) -> Reply:
        try:
            return self._attempt(text)
        except (LinkError, InstrumentError) as err:
            self._link.wire_log.note("asking again")
            reply = self._attempt(text)
            note_recovered(str(err))
            return reply

    def _attempt(self, text: str) -> Reply:
        try:
            self._link.send(encode(text))
            return self._receive()
        except LinkCutError as err:
            says = self._link.address.left_out(err)
            raise LinkCutError(f"{self._name}: sent {text!r}, expected a reply: {says}; {self._last_heard()}") from err
        except LinkError as err:
            self._link.cut("given up: no reply in time")
            raise LinkError(
                f"{self._name}: sent {text!r}, no reply within {self._timeout_s:g} s; check that the controller"
                f" is in remote mode and that nobody else holds its link; {self._last_heard()}"
            ) from err
        except InstrumentError as err:
            self._link.cut("given up: not ACL")
            raise InstrumentError(
                f"{self._name}: sent {text!r}, expected an ACL reply: {err}; check that the address is an ACUTROL3000's"
            ) from err

    def _receive(self) -> Reply:
        reader = ReplyReader(self._terminator)
        deadline_s = time.monotonic() + self._timeout_s
        while True:
            data = self._link.receive(4096, deadline_s - time.monotonic())
            if not data.isascii():
                raise InstrumentError(f"bytes that are no ASCII, {data[:32]!r}")
            if replies := reader.feed(data):
                return replies[0]

    def _last_heard(self) -> str:
        return f"last on the wire: {self._link.wire_log.tail(3)}"


def _listed(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:.6g}" for value in values)


class Mode(Enum):
    """Modes of the axis; the values are the beginnings of the names by which `:mode?` may call them."""

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
        for mode in ("pos", "rate", "synt")  # each has its own
    )
    for name, key in (("rate limit [deg/s]", ":lim:rate"), ("acceleration limit [deg/s²]", ":lim:acc"))
)

ASK_MOTION = ":read:pos? {axis};rate? {axis};acc? {axis}"  # deg, deg/s, deg/s²
ASK_MODE = ":mode? {axis}"
ASK_INTERLOCK = ":interlock? {axis}"
ASK_STATUS = "*stb?"
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
SLEW = ":con:osc {axis},Enable,{},{},Pos,Lin"  # how fast amplitude [deg/s] and frequency [Hz/s] go to new values


class Acutrol3000(Instrument):
    """One axis of an ACUTROL3000; an `benchctl_instruments.interfaces.RateTable`. Safe to call from several threads.

    Parameters
    ----------
    address
        `tcp://HOST:PORT`.
    axis
        The controller's number of the axis.
    timeout_s
        How long to wait for a connection, and for a reply; wall time.
    pause_s
        Bench time that the controller is given after a change of mode or interlock.
    rest_rate_dps
        Up to this rate the table counts as at rest.
    rise_cycles
        An oscillation reaches its amplitude and frequency in this many of its periods.
    set_slew
        False leaves the oscillator's slew rates as the controller has them; one laboratory could not set them.
    demand_queries
        False where the controller does not answer with its demands, see above.
    status_bits
        Names of the bits of the status byte by their numbers, `{"0": "…"}`, for error messages.
    reply_terminator
        What ends a reply on this site's link.
    """

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
        self._name = f"rate table {address}"
        self._line = AclDialogue(
            self._name,
            TcpLink(address, reconnect=reconnect, wire_log=wire_log),
            axis=axis,
            timeout_s=timeout_s,
            terminator=reply_terminator.encode("ascii"),
            explain=lambda: self._fault() or "no fault is reported",
        )
        self._clock = clock
        self._pause_s = pause_s
        self._rest_rate_dps = rest_rate_dps
        self._rise_cycles = rise_cycles
        self._set_slew = set_slew
        self._demand_queries = demand_queries
        self._status_bits = {int(bit): name for bit, name in (status_bits or {}).items()}
        self._lock = threading.RLock()  # a method's writes and their confirmation belong together

    # What every instrument does ---------------------------------------------------------------------------------------

    def open(self) -> None:
        """Connect; whoever names a mode when asked for it is taken for an ACUTROL."""
        self._line.open()
        try:
            self._mode()
        except (LinkError, InstrumentError):
            self._line.close()
            raise

    def close(self) -> None:
        """Let go of the link; the table goes on with what it was doing."""
        self._line.close()

    def identify(self) -> Identity:
        """What `*idn?` says, if that is the usual manufacturer,model,serial,firmware; otherwise nothing is known."""
        words = [word.strip() for word in self._line.ask(ASK_IDENTITY).split(",")]
        if len(words) != 4:
            return Identity()
        return Identity(manufacturer=words[0], model=words[1], serial=words[2], firmware=words[3])

    # What a rate table does -------------------------------------------------------------------------------------------

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
            self._line.tell(RESET, once=True)  # a second reset would clear what has happened since the first
            self._pause()
            self._fail_on_fault("the interlock was reset and is in fault again")
            self._line.tell(SET_MODE[Mode.OFF])
            self._line.tell(CLOSE_LOOP)
            self._pause()
            self.go_to_rate(0.0)

    def disable(self) -> None:
        """Mode off, then the loop opens; `UsageError` while the table moves."""
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
        """Turn at a constant rate, in rate mode."""
        _finite("rate", rate_dps)
        with self._lock:
            self._demand(RATE_DEMAND, rate_dps)
            self._enter(Mode.RATE)

    def go_to_angle(self, angle_deg: float) -> None:
        """Turn to an angle the short way round, in position mode; it starts from holding the present angle."""
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
        """Oscillate about the present angle, in synthesizer mode; the amplitude rises during `rise_cycles` periods."""
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
        """Rate demand 0 in rate mode; a table in mode off is left alone, since its controller stops it by itself."""
        with self._lock:
            if self._mode() is not Mode.OFF:
                self.go_to_rate(0.0)

    def read(self) -> TableReading:
        """Angle, rate and acceleration by one query."""
        angle_deg, rate_dps, acceleration_dps2 = self._line.numbers(ASK_MOTION, 3, ";")
        return TableReading(angle_deg=angle_deg % 360.0, rate_dps=rate_dps, acceleration_dps2=acceleration_dps2)

    def state(self) -> TableState:
        """From interlock, mode and rate: a fault or an abort before disabled before moving."""
        with self._lock:
            interlock, mode = self._line.ask(ASK_INTERLOCK).lower(), self._mode()
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
        """Enter a mode, or confirm that the table is in it; either way nothing may have tripped meanwhile."""
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
        said = self._line.ask(ASK_MODE)
        for mode in Mode:
            if said.lower().startswith(mode.value):
                return mode
        raise InstrumentError(
            f"{self._name}: asked for the mode, expected a name such as Rate or Position, got {said[:MOST_SHOWN]!r};"
            " check that the address is an ACUTROL3000's"
        )

    def _fail_on_fault(self, what: str) -> None:
        fault = self._fault()
        if fault:
            raise InstrumentError(f"{self._name}: {what}: {fault}")

    def _fault(self) -> str:
        """What is wrong and what to do, in words; empty where neither the interlock nor the mode reports a fault."""
        interlock, mode = self._line.ask(ASK_INTERLOCK), self._mode()
        if not interlock.lower().startswith("fault") and mode is not Mode.ABORT:
            return ""
        status = self._line.ask(ASK_STATUS)
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
