"""A chamber with a Watlow F4T controller by SCPI, lines of ASCII over TCP port 5025. Not tried on hardware.

Sources, all public clients: DAsh0244/te107_control `f4t_control.py`, PaulNongL/WatlowF4TscpiLibrary, Google's
py-lab-hal `testequity107.py`. They show no alarms, no power and no limits of the set point: the driver keeps those of
the bench; `watlow_f4t` reads more, by Modbus. Commands have no answer, so each is read back. A client waits 0.1 s or
more between two lines; so does the driver.

Fault handling: as in `line_chamber`. A set point or switch that is not kept is sent once more, then it raises
`InstrumentError`; so does a profile that runs or is held, at `start`. A chamber that stopped by itself is an alarm. The
answers for the state of a profile are not published; those that contain RUN, HOLD or PAUSE count.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, get_args

from benchctl_instruments.chambers.line_chamber import SETPOINT, KeptLimitsChamber
from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.interfaces import ChamberReading, Clock, Identity
from benchctl_instruments.links.lines import LineDialogue, Manners
from benchctl_instruments.links.serial_port import byte_link
from benchctl_instruments.links.tcp import Reconnect
from benchctl_instruments.links.wirelog import WireLog, note_recovered
from benchctl_instruments.protocols.lines import MOST_SHOWN, UnreadableError, parse_number
from benchctl_instruments.recognition import ByLine

OnBy = Literal["output", "nothing"]
ASK_IDENTITY, ASK_UNIT, ASK_PROFILE = "*IDN?", ":UNIT:TEMPERATURE?", ":PROGRAM:SELECTED:STATE?"
NAME = "Watlow F4T"
PAUSE_S = 0.1
BUSY = ("RUN", "HOLD", "PAUSE")
STATES = ("OFF", "ON")
LOOPS, OUTPUTS = range(1, 5), range(1, 9)


def _read_unit(answer: str) -> str:
    """Return C or F; raises `UnreadableError` for another answer."""
    if answer not in ("C", "F"):
        raise UnreadableError(f"expected the unit C or F, got {answer[:MOST_SHOWN]!r}")
    return answer


def _read_state(answer: str) -> bool:
    if answer not in STATES:
        raise UnreadableError(f"expected ON or OFF, got {answer[:MOST_SHOWN]!r}")
    return answer == "ON"


class WatlowF4TScpi(KeptLimitsChamber):
    """Driver of a chamber with a Watlow F4T. Not tried on hardware; its unit must be set to degrees Celsius.

    Parameters
    ----------
    address
        `tcp://HOST:5025`, or `visa://TCPIP0::HOST::5025::SOCKET`.
    loop
        The control loop of the air, 1 to 4.
    on_by, on_number
        What the chamber's manufacturer wired to conditioning on/off: "output", and its number, 1 to 8 (TestEquity:
        output 1), or "nothing": the chamber conditions while it has power, and `start` and `stop` do not change that.
    clock, timeout_s, wire_log
        See `LineChamber`.
    reconnect
        See `byte_link`.
    """

    recognition = (
        ByLine(
            query=ASK_UNIT,
            read=lambda answer: f"Watlow F4T by SCPI, in °{_read_unit(answer)}",
            names=("F4T",),
            sent_end=b"\n",
            schemes=("tcp",),
        ),
    )

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        loop: int = 1,
        on_by: OnBy = "output",
        on_number: int = 1,
        timeout_s: float = 2.0,
        reconnect: Reconnect | None = None,
        wire_log: WireLog | None = None,
    ) -> None:
        if loop not in LOOPS or on_by not in get_args(OnBy) or on_number not in OUTPUTS:
            raise UsageError(
                f"loop {loop}, on_by {on_by!r}, on_number {on_number}: expected a loop of 1 to {LOOPS[-1]}, one of"
                f" {', '.join(get_args(OnBy))}, and an output of 1 to {OUTPUTS[-1]}"
            )
        lines = LineDialogue(
            NAME,
            byte_link(address, reconnect=reconnect, wire_log=wire_log),
            manners=Manners(sent_end=b"\n", timeout_s=timeout_s, pause_s=PAUSE_S, commands_answered=False),
            clock=clock,
        )
        super().__init__(lines, clock=clock, controller="a Watlow F4T at its SCPI port")
        self._loop = f":SOURCE:CLOOP{loop}"
        self._output = f":OUTPUT{on_number}:STATE" if on_by == "output" else ""

    def identify(self) -> Identity:
        """Return the answer to `*IDN?`, as manufacturer, model, serial and firmware if it has four parts."""
        answer = self._ask(ASK_IDENTITY, str)
        words = [word.strip() for word in answer.split(",")]
        if len(words) != 4:
            return Identity(manufacturer="Watlow", model=answer)
        return Identity(manufacturer=words[0], model=words[1], serial=words[2], firmware=words[3])

    def start(self) -> None:
        """Switch conditioning on. Raises `InstrumentError` if a profile runs or is held."""
        profile = self._ask(ASK_PROFILE, str).upper()
        if any(word in profile for word in BUSY):
            self._refuse_program()
        self._switch(on=True)

    def stop(self) -> None:
        """Switch conditioning off. The set point does not change."""
        self._switch(on=False)

    def read(self) -> ChamberReading:
        """Return air temperature and set point; power is NaN, and the only alarm is that of a chamber that stopped."""
        return ChamberReading(
            temperature_c=self._ask(f"{self._loop}:PVALUE?", parse_number),
            setpoint_c=self._setpoint_c(),
            power_percent=math.nan,
            alarms=self._left(on=self._runs()),
        )

    def _check_controller(self) -> None:
        if self._ask(ASK_UNIT, _read_unit) != "C":
            raise InstrumentError(
                f"{self._who}: its temperatures are in °F; set the unit of its communication to °C at the panel"
            )
        self._setpoint_c()
        self._runs()

    def _setpoint_c(self) -> float:
        return self._ask(f"{self._loop}:SPOINT?", parse_number)

    def _put(self, setpoint_c: float) -> None:
        self._do(
            f"{self._loop}:SPOINT {setpoint_c:.1f}",
            lambda: self._confirm_number(SETPOINT, setpoint_c, self._setpoint_c),
        )

    def _runs(self) -> bool:
        return not self._output or self._ask(f"{self._output}?", _read_state)

    def _switch(self, *, on: bool) -> None:
        if self._output:
            self._do(
                f"{self._output} {STATES[on]}",
                lambda: self._confirm(STATES[on], lambda: STATES[self._runs()]),
            )
        self._switched_on = on

    def _do(self, command: str, confirm: Callable[[], None]) -> None:
        """Send a command and confirm it; without an answer a lost one shows only so, and is sent once more."""
        self._lines.tell(command, repeatable=True)
        try:
            confirm()
        except InstrumentError as err:
            self._lines.tell(command, repeatable=True)
            confirm()
            note_recovered(str(err))


Driver = WatlowF4TScpi
