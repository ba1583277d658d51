"""A Weiss or Vötsch chamber over ASCII-2: lines of text over RS-232, RS-485 or TCP port 2049.

Not tried on hardware. Requests and answers: descriptions that four chambers gave of themselves, ondrejh/VT4002,
Embida/pyVT4002 and a client of a Weiss WT120, see `benchctl_instruments.protocols.ascii2`. Values have one decimal.

A request that writes carries all set values and digital channels, so the driver reads them first and changes only the
temperature and channel DO01, which starts the chamber. The order of the values comes from the chamber's own
description; a chamber without one is refused. The range of the set point can only be read, so the driver keeps the
limits of the bench. Set the chamber to external operation; S!MPAC controllers may ignore requests that write: use
`weiss_simserv` with these. Ramps are not supported: public sources disagree on request U. A ramp set on the controller
makes the set point read back move.

Fault handling: as in `line_chamber`. A set point or start that is not kept raises `InstrumentError`. The protocol has
no alarms: the only one that is reported is a chamber that stopped by itself. A single reading does not show air that is
stuck or stalls short of the set point; a soak that does not end shows it.
"""

from __future__ import annotations

import math
from functools import partial

from benchctl_instruments.chambers.line_chamber import SETPOINT, KeptLimitsChamber
from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.interfaces import ChamberReading, Clock, Identity
from benchctl_instruments.links.lines import LineDialogue, Manners, NoAnswerError
from benchctl_instruments.links.serial_port import byte_link
from benchctl_instruments.links.tcp import Reconnect
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.protocols import ascii2
from benchctl_instruments.protocols.ascii2 import Description, State
from benchctl_instruments.recognition import ByLine

BAUD = 9600
QUIET_S = 0.5


class WeissAscii2(KeptLimitsChamber):
    """Driver of a Weiss or Vötsch chamber over ASCII-2. Not tried on hardware. Thread-safe.

    Power is NaN: the protocol does not report it.

    Parameters
    ----------
    address
        `serial://DEVICE?baud=9600` (or as set on the controller), `tcp://HOST:2049` or `socket://HOST:PORT`.
    unit_id
        The chamber's address, 0 to 99; clients of real chambers use 0 and 1.
    clock, timeout_s, wire_log
        See `LineChamber`.
    reconnect
        See `byte_link`.
    """

    recognition = (
        ByLine(
            query=ascii2.request(1, "I"),
            read=ascii2.recognised,
            sent_end=b"\r",
            answer_end=None,
            encoding="latin-1",
            baud=BAUD,
        ),
    )

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        unit_id: int = 1,
        timeout_s: float = 3.0,
        reconnect: Reconnect | None = None,
        wire_log: WireLog | None = None,
    ) -> None:
        if unit_id not in range(100):
            raise UsageError(f"unit_id = {unit_id}; give the chamber's address, 0 to 99")
        lines = LineDialogue(
            f"Weiss/Vötsch ASCII-2, address {unit_id},",
            byte_link(address, default_baud=BAUD, reconnect=reconnect, wire_log=wire_log),
            manners=Manners(sent_end=b"\r", answer_end=None, encoding="latin-1", timeout_s=timeout_s),
            clock=clock,
        )
        super().__init__(lines, clock=clock, controller="a chamber with ASCII-2")
        self._unit_id = unit_id
        self._description: Description | None = None

    def identify(self) -> Identity:
        """Return the manufacturer and protocol: ASCII-2 states neither type nor serial number."""
        self._state()
        return Identity(manufacturer="Weiss/Vötsch", model="ASCII-2")

    def start(self) -> None:
        """Switch the start channel on."""
        self._switch(on=True)

    def stop(self) -> None:
        """Switch the start channel off. The set point does not change."""
        self._switch(on=False)

    def read(self) -> ChamberReading:
        """Return air temperature and set point; power is NaN, and the only alarm is that of a chamber that stopped."""
        state = self._state()
        return ChamberReading(
            temperature_c=state.air_c,
            setpoint_c=state.setpoint_c,
            power_percent=math.nan,
            alarms=self._left(on=state.started),
        )

    def _check_controller(self) -> None:
        ask = partial(self._lines.ask_text, quiet_s=QUIET_S)
        try:
            found = self._exchange(ascii2.request(self._unit_id, "?"), ask, ascii2.read_description)
        except NoAnswerError as err:
            raise NoAnswerError(f"{err}; a chamber that does not describe itself is not supported") from err
        self._description = found
        self._own_limits_c = (found.low_c, found.high_c)
        self._state()

    def _put(self, setpoint_c: float) -> None:
        state = self._state()
        self._write(state, setpoint_c=setpoint_c, start=state.started)
        self._confirm_number(SETPOINT, setpoint_c, lambda: self._state().setpoint_c)

    def _switch(self, *, on: bool) -> None:
        self._write(self._state(), setpoint_c=None, start=on)
        self._confirm_number("start channel {:g}", int(on), lambda: int(self._state().started))
        self._switched_on = on

    def _write(self, state: State, *, setpoint_c: float | None, start: bool) -> None:
        values, channels = ascii2.changed(self._described(), state, setpoint_c=setpoint_c, start=start)
        send = partial(self._lines.tell, repeatable=True)
        self._exchange(ascii2.set_request(self._unit_id, values, channels), send, ascii2.read_accepted)

    def _state(self) -> State:
        description = self._described()
        return self._ask(ascii2.request(self._unit_id, "I"), lambda line: ascii2.read_state(line, description))

    def _described(self) -> Description:
        if self._description is None:
            raise InstrumentError(f"{self._who}: it is not open; call open() first")
        return self._description


Driver = WeissAscii2
