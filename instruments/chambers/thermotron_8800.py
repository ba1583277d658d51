"""A chamber with a Thermotron 8800 controller: lines of ASCII over TCP port 8888, RS-232 or a serial-to-Ethernet box.

Not tried on hardware. Commands and codes: the maker's "Interface Command Descriptions" and two public clients, see
`benchctl_instruments.protocols.thermotron`; what all Thermotron drivers do is in `chambers.thermotron`. No public
source describes how a program differs from manual mode: make sure that none runs.

Alarms are those of the process; alarms of the deviation are left out, since every step of the set point raises them.
Power is the throttle as the controller states it; no source gives its sign for cooling.
"""

from __future__ import annotations

from functools import partial

from benchctl_instruments.chambers.line_chamber import RAMP, ramp_refused
from benchctl_instruments.chambers.thermotron import Thermotron, recognition_of
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.interfaces import ChamberReading, Clock, Identity
from benchctl_instruments.links.tcp import Reconnect
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.protocols import thermotron
from benchctl_instruments.protocols.lines import parse_number


class Thermotron8800(Thermotron):
    """Driver of a chamber with a Thermotron 8800. Not tried on hardware. Thread-safe.

    Parameters
    ----------
    address
        `tcp://HOST:8888`, or see `Thermotron`.
    ramp_c_per_min
        The controller's own ramp of manual mode, written at `start`; None: it stays as set on the controller.
    clock, timeout_s, reconnect, wire_log
        As for `Thermotron`.
    """

    recognition = recognition_of("8800")
    NAME, COMMANDS_ANSWERED = "Thermotron 8800", True

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
        super().__init__(address, clock=clock, timeout_s=timeout_s, reconnect=reconnect, wire_log=wire_log)
        self._ramp_c_per_min = ramp_c_per_min

    def identify(self) -> Identity:
        """Return the controller's name and the version of its software."""
        return Identity(
            manufacturer="Thermotron",
            model=self._ask(thermotron.IDENTITY, str),
            firmware=self._ask(thermotron.VERSION, str),
        )

    def start(self) -> None:
        """Run in manual mode, with the last set point."""
        if not self._runs():
            self._send_setpoint()
            self._tell(thermotron.RUN)
            self._confirm_running(on=True)
        self._switched_on = True
        if self._ramp_c_per_min is not None:
            self._tell(thermotron.set_value(thermotron.RAMP, self._ramp_c_per_min))
            ramp = partial(self._ask, thermotron.query(thermotron.RAMP), parse_number)
            self._confirm_number(RAMP, self._ramp_c_per_min, ramp)
        self._send_setpoint()  # in manual mode it is taken over at once
        self._confirm_setpoint()

    def read(self) -> ChamberReading:
        """Return air temperature, set point, throttle and alarms."""
        return ChamberReading(
            temperature_c=self._air_c(),
            setpoint_c=self._setpoint_c(),
            power_percent=self._ask(thermotron.THROTTLE, parse_number),
            alarms=self._alarms(),
        )

    def _check_controller(self) -> None:
        self._air_c()
        self._setpoint_c()
        self._runs()

    def _put(self, setpoint_c: float) -> None:
        self._wanted_c = setpoint_c
        self._send_setpoint()
        if self._runs():
            self._confirm_setpoint()

    def _runs(self) -> bool:
        return self._ask(thermotron.STOP_CODE, thermotron.read_code) == thermotron.RUNNING

    def _alarms(self) -> tuple[str, ...]:
        bits = self._ask(thermotron.ALARM, thermotron.read_code)
        code = self._ask(thermotron.STOP_CODE, thermotron.read_code)
        why = thermotron.STOPS.get(code, f"stop code {code}")
        standing = tuple(text for bit, text in thermotron.PROCESS_ALARMS.items() if bits & bit)
        return (*standing, *self._left(on=code == thermotron.RUNNING, why=why))

    def _tell(self, command: str) -> None:
        code = self._exchange(command, lambda text: self._lines.tell(text, repeatable=True), thermotron.read_code)
        if code != thermotron.ACCEPTED:
            raise InstrumentError(
                f"{self._who}: {command!r} was refused with code {code}, see its manual; check that no program runs,"
                " and that the panel lets a computer control it"
            )


Driver = Thermotron8800
