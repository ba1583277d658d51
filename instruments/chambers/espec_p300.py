"""A chamber with an ESPEC P-300 or SCP-220 controller: lines of ASCII over RS-232, RS-485 or a serial-to-Ethernet box.

Not tried on hardware. Commands, answers and refusals: EspecNorthAmerica/ChamberConnectLibrary (p300.py) and
akaeba/ATWG, see `benchctl_instruments.protocols.p300`. Numbers have one decimal.

The driver controls temperature only: humidity control stays as set on the panel. The set point takes effect in mode
CONSTANT only; it is accepted in STANDBY and stored until then. The low and high alarms are also the limits of the set
point: `set_limits` sets them, and air outside them raises an alarm.

Fault handling: a request without an answer in time, or with an unreadable answer, is repeated on a new connection as
in `links.lines`, since a command states a value and not a change. CHB NOT READY is waited out; any other NA and a set
point that is not kept raise `InstrumentError`; every reading includes the alarms. A single reading does not show air
that is stuck or stalls short of the set point; a soak that does not end shows it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from functools import partial

from benchctl_instruments.chambers.line_chamber import Answer, LineChamber
from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.interfaces import ChamberReading, Clock, Identity
from benchctl_instruments.links.lines import LineDialogue, Manners
from benchctl_instruments.links.serial_port import byte_link
from benchctl_instruments.links.tcp import Reconnect
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.protocols import p300
from benchctl_instruments.protocols.p300 import Temperatures
from benchctl_instruments.recognition import ByLine

BAUD = 9600
ASK_READY_S = 0.5
WORDS = {"setpoint_c": "set point", "high_c": "high alarm", "low_c": "low alarm"}


class EspecP300(LineChamber):
    """Driver of a chamber with an ESPEC P-300 or SCP-220. Not tried on hardware. Thread-safe.

    Power is that of the heater only: these controllers do not report the power of the refrigerator.

    Parameters
    ----------
    address
        `serial://DEVICE?baud=9600` (or as set on the controller), `tcp://HOST:10001` or `socket://HOST:PORT`.
    rs485_address
        The chamber's number on RS-485, sent before every request; None on RS-232 and through the box.
    pause_s
        Quiet time between two exchanges; one open driver leaves 0.3 s, the manufacturer's library none.
    ready_s
        How long to repeat a request while the chamber reports that it, or its data, is not ready.
    alarm_words
        Meanings of the alarm codes, `{"12": "…"}`, from the chamber's manual: no public list exists.
    clock, timeout_s, wire_log
        See `LineChamber`.
    reconnect
        See `byte_link`.
    """

    recognition = (ByLine(query=p300.TYPE_QUERY, read=lambda line: f"ESPEC {p300.read_type(line)}", baud=BAUD),)

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        rs485_address: int | None = None,
        timeout_s: float = 3.0,
        pause_s: float = 0.0,
        ready_s: float = 5.0,
        alarm_words: Mapping[str, str] | None = None,
        reconnect: Reconnect | None = None,
        wire_log: WireLog | None = None,
    ) -> None:
        if rs485_address is not None and rs485_address < 1:
            raise UsageError(f"rs485_address = {rs485_address}; give the chamber's number, 1 or more")
        lines = LineDialogue(
            "ESPEC P300" if rs485_address is None else f"ESPEC P300, number {rs485_address},",
            byte_link(address, default_baud=BAUD, reconnect=reconnect, wire_log=wire_log),
            manners=Manners(timeout_s=timeout_s, pause_s=pause_s),
            clock=clock,
        )
        super().__init__(lines, clock=clock, controller="an ESPEC P-300 or SCP-220")
        self._rs485_address = rs485_address
        self._ready_s = ready_s
        self._alarm_words = dict(alarm_words or {})

    def identify(self) -> Identity:
        """Return the controller's name and firmware version."""
        controller = self._ask(p300.TYPE_QUERY, p300.read_type)
        return Identity(manufacturer="ESPEC", model=controller, firmware=self._ask(p300.ROM_QUERY, str))

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Program the low and high alarms, which are also the limits of the set point.

        They are sent in one line together with the present set point, or the nearest one within them: the controller
        rejects a set point outside its alarms, and alarms that exclude the set point.
        """
        self._require_order(low_c, high_c)
        setpoint_c = min(max(self._setpoint_c(self._temperatures()), low_c), high_c)
        self._put(setpoint_c=setpoint_c, high_c=high_c, low_c=low_c)

    def start(self) -> None:
        """Switch conditioning on: mode CONSTANT. Raises `InstrumentError` if a program is running."""
        if p300.RUN in (mode := self._mode()):
            self._refuse_program()
        self._enter(p300.CONSTANT, mode)

    def stop(self) -> None:
        """Switch conditioning off: mode STANDBY, or OFF if the panel is switched off. The set point does not change."""
        if (mode := self._mode()) != p300.OFF:
            self._enter(p300.STANDBY, mode)

    def go_to(self, setpoint_c: float) -> None:
        """Set a set point between the alarms and confirm it; the air follows within the chamber's ramp."""
        now = self._temperatures()
        if not (math.isfinite(setpoint_c) and now.low_c <= p300.tenths(setpoint_c) <= now.high_c):
            raise UsageError(
                f"{self._who}: set point {setpoint_c:g} °C lies outside"
                f" the controller's limits {now.low_c:g} to {now.high_c:g} °C"
            )
        self._put(setpoint_c=setpoint_c)

    def read(self) -> ChamberReading:
        """Return air temperature, set point, heater power and alarms."""
        now = self._temperatures()
        return ChamberReading(
            temperature_c=now.air_c,
            setpoint_c=self._setpoint_c(now),
            power_percent=self._ask(p300.HEATER_QUERY, p300.read_heater),
            alarms=tuple(map(self._alarm, self._ask(p300.ALARM_QUERY, p300.read_alarms))),
        )

    # Reading and writing ----------------------------------------------------------------------------------------------

    def _check_controller(self) -> None:
        self._ask(p300.TYPE_QUERY, p300.read_type)
        now = self._temperatures()
        if now.low_c >= now.high_c:
            raise InstrumentError(
                f"{self._who}: its alarms read {now.low_c:g} and {now.high_c:g} °C, low not below high;"
                " check that it is the right model"
            )

    def _temperatures(self) -> Temperatures:
        return self._ask(p300.TEMP_QUERY, p300.read_temperatures)

    def _setpoint_c(self, temperatures: Temperatures) -> float:
        if temperatures.setpoint_c is None:
            raise InstrumentError(f"{self._who}: its set point is switched off; switch temperature control on")
        return temperatures.setpoint_c

    def _mode(self) -> str:
        return self._ask(p300.MODE_QUERY, p300.read_mode)

    def _alarm(self, code: int) -> str:
        words = self._alarm_words.get(str(code), "see the chamber's manual")
        return f"alarm {code} ({words})"

    def _put(self, **wanted_c: float) -> None:
        """Send temperatures and read them back."""
        self._tell(p300.set_temperatures(**wanted_c))
        wanted = _listed({name: p300.tenths(value_c) for name, value_c in wanted_c.items()})
        self._confirm(wanted, lambda: _listed(_chosen(self._temperatures(), wanted_c)))

    def _enter(self, mode: str, present: str) -> None:
        if mode != present:
            self._tell(p300.set_mode(mode))
        self._confirm(mode, self._mode)

    # One exchange -----------------------------------------------------------------------------------------------------

    def _ask(self, query: str, read: Callable[[str], Answer]) -> Answer:
        send = partial(self._lines.ask, skip=p300.is_accepted)
        return self._exchange(query, partial(self._until_ready, send=send), read)

    def _tell(self, command: str) -> None:
        send = partial(self._lines.tell, repeatable=True)
        self._exchange(command, partial(self._until_ready, send=send), p300.read_accepted)

    def _until_ready(self, request: str, *, send: Callable[[str], str]) -> str:
        """Return the answer as soon as it is not a "not ready" refusal."""
        started_s = self._clock.now()
        while True:
            line = send(p300.addressed(request, self._rs485_address))
            reason = p300.refusal(line)
            if reason is None:
                return line
            waited_s = self._clock.now() - started_s
            if reason not in p300.PASSING_REFUSALS or waited_s >= self._ready_s:
                duration = f" for {waited_s:.1f} s" if waited_s > 0 else ""
                raise InstrumentError(
                    f"{self._who}: {request!r} was refused{duration} with {line!r}: {p300.refusal_words(reason)}"
                )
            self._clock.sleep(ASK_READY_S)


def _chosen(temperatures: Temperatures, names: Iterable[str]) -> dict[str, float | None]:
    return {name: getattr(temperatures, name) for name in names}


def _listed(temperatures_c: Mapping[str, float | None]) -> str:
    return ", ".join(
        f"{WORDS[name]} {'off' if value_c is None else f'{value_c:g} °C'}" for name, value_c in temperatures_c.items()
    )


Driver = EspecP300
