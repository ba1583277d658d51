"""A Weiss or Vötsch chamber with S!MPAC or Simpati over SIMSERV, lines of text over TCP port 2049.

Not tried on hardware. Commands and refusals: SiLab-Bonn/basil, IzaakWN/ClimateChamberMonitor and
SengerM/VotschTechnik-climate-chamber-Python with ami3go's fork, see `benchctl_instruments.protocols.simserv`.

The driver controls temperature only, control variable 1; humidity and the other digital channels stay as set on the
panel. Digital channel 1 starts and stops manual operation. The range of the set point can only be read, so the driver
keeps the limits of the bench. `stop` also ends a program; `start` refuses while one is running.

Fault handling: as in `line_chamber`. A refusal and a set point that is not kept raise `InstrumentError`; every reading
includes the active messages of type alarm; warnings are left to the panel. A single reading does not show air that is
stuck or stalls short of the set point; a soak that does not end shows it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from benchctl_instruments.chambers.line_chamber import RAMP, SETPOINT, Answer, KeptLimitsChamber, ramp_refused
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.interfaces import ChamberReading, Clock, Identity
from benchctl_instruments.links.lines import LineDialogue, Manners
from benchctl_instruments.links.tcp import Reconnect, TcpLink
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.protocols import simserv
from benchctl_instruments.protocols.simserv import START, TEMPERATURE
from benchctl_instruments.recognition import ByLine


class WeissSimserv(KeptLimitsChamber):
    """Driver of a Weiss or Vötsch chamber over SIMSERV. Not tried on hardware. Thread-safe.

    Power is NaN: no public command reports it.

    Parameters
    ----------
    address
        `tcp://HOST:2049`.
    ramp_c_per_min
        The controller's own ramp (gradient) in both directions, written at `start`; None: it stays as it is.
    clock, timeout_s, wire_log
        See `LineChamber`.
    reconnect
        See `TcpLink`.
    """

    recognition = (
        ByLine(
            query=simserv.command(simserv.INFO, simserv.TYPE),
            read=lambda line: f"Weiss/Vötsch {simserv.read_text(line)}",
            sent_end=b"\r",
            encoding=simserv.ENCODING,
            schemes=("tcp",),
        ),
    )

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        ramp_c_per_min: float | None = None,
        timeout_s: float = 3.0,
        reconnect: Reconnect | None = None,
        wire_log: WireLog | None = None,
    ) -> None:
        ramp_refused(ramp_c_per_min)
        lines = LineDialogue(
            "Weiss/Vötsch SIMSERV",
            TcpLink(address, reconnect=reconnect, wire_log=wire_log),
            manners=Manners(sent_end=b"\r", encoding=simserv.ENCODING, timeout_s=timeout_s),
            clock=clock,
        )
        super().__init__(lines, clock=clock, controller="a chamber with SIMSERV, at port 2049")
        self._ramp_c_per_min = ramp_c_per_min

    def identify(self) -> Identity:
        """Return the chamber's type and serial number; SIMSERV states no manufacturer."""
        return Identity(
            manufacturer="Weiss/Vötsch",
            model=self._get(simserv.read_text, simserv.INFO, simserv.TYPE),
            serial=self._get(simserv.read_text, simserv.INFO, simserv.SERIAL),
        )

    def start(self) -> None:
        """Start manual operation. Raises `InstrumentError` if a program is running."""
        if self._program_runs():
            self._refuse_program()
        if self._ramp_c_per_min is not None:
            self._set_gradients(self._ramp_c_per_min)
        self._switch(on=True)

    def stop(self) -> None:
        """Stop manual operation, and a program if one is running. The set point does not change."""
        if self._program_runs():
            self._tell(simserv.STOP_PROGRAM)
        self._switch(on=False)

    def read(self) -> ChamberReading:
        """Return air temperature, set point and alarms; power is NaN."""
        return ChamberReading(
            temperature_c=self._get(simserv.read_number, simserv.GET_ACTUAL, TEMPERATURE),
            setpoint_c=self._setpoint_c(),
            power_percent=math.nan,
            alarms=self._alarms(),
        )

    def _check_controller(self) -> None:
        self._get(simserv.read_text, simserv.INFO, simserv.TYPE)
        self._setpoint_c()
        low_c = self._get(simserv.read_number, simserv.GET_LOWEST, TEMPERATURE)
        high_c = self._get(simserv.read_number, simserv.GET_HIGHEST, TEMPERATURE)
        if low_c >= high_c:
            raise InstrumentError(
                f"{self._who}: the limits of its set point read {low_c:g} and {high_c:g} °C, low not below high;"
                " check that control variable 1 is the temperature"
            )
        self._own_limits_c = (low_c, high_c)

    def _put(self, setpoint_c: float) -> None:
        self._tell(simserv.SET_SETPOINT, TEMPERATURE, setpoint_c)
        self._confirm_number(SETPOINT, setpoint_c, self._setpoint_c)

    def _setpoint_c(self) -> float:
        return self._get(simserv.read_number, simserv.GET_SETPOINT, TEMPERATURE)

    def _set_gradients(self, c_per_min: float) -> None:
        for write, read in (
            (simserv.SET_GRADIENT_UP, simserv.GET_GRADIENT_UP),
            (simserv.SET_GRADIENT_DOWN, simserv.GET_GRADIENT_DOWN),
        ):
            self._tell(write, TEMPERATURE, float(c_per_min))
            self._confirm_number(RAMP, c_per_min, partial(self._get, simserv.read_number, read, TEMPERATURE))

    def _switch(self, *, on: bool) -> None:
        self._tell(simserv.SET_DIGITAL, START, int(on))
        started = partial(self._get, simserv.read_whole, simserv.GET_DIGITAL, START)
        self._confirm_number("start channel {:g}", int(on), started)

    def _program_runs(self) -> bool:
        line = self._exchange(simserv.command(simserv.GET_PROGRAM_STATUS), self._lines.ask, _checked)
        code, _ = simserv.read_answer(line)
        return code == simserv.ACCEPTED and simserv.read_whole(line) != 0  # without programs it knows no such command

    def _alarms(self) -> tuple[str, ...]:
        status = self._get(simserv.read_whole, simserv.STATUS)
        if not status & simserv.ALARM:
            return ()
        texts = []
        for index in range(1, self._get(simserv.read_whole, simserv.GET_MESSAGES) + 1):
            active = self._get(simserv.read_whole, simserv.GET_MESSAGE_STATUS, index)
            if active and self._get(simserv.read_whole, simserv.GET_MESSAGE_TYPE, index) & simserv.ALARM_MESSAGE:
                texts.append(self._get(simserv.read_text, simserv.GET_MESSAGE_TEXT, index))
        return tuple(texts) or (f"alarm (status {status}, without a message; see the panel)",)

    # One exchange -----------------------------------------------------------------------------------------------------

    def _get(self, read: Callable[[str], Answer], number: int, *arguments: int) -> Answer:
        return self._exchange(simserv.command(number, *arguments), partial(self._accepted, self._lines.ask), read)

    def _tell(self, number: int, *arguments: float) -> None:
        send = partial(self._accepted, partial(self._lines.tell, repeatable=True))
        self._exchange(simserv.command(number, *arguments), send, simserv.read_accepted)

    def _accepted(self, send: Callable[[str], str], request: str) -> str:
        """Return an answer that is no refusal."""
        line = send(request)
        code, _ = simserv.read_answer(line)
        if code < 0:
            words = simserv.REFUSALS.get(code, "see the chamber's manual")
            raise InstrumentError(f"{self._who}: {request!r} was refused with {line!r}: {words}")
        return line


def _checked(line: str) -> str:
    simserv.read_answer(line)
    return line


Driver = WeissSimserv
