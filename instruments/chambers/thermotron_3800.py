"""A chamber with a Thermotron 3800 controller: lines of ASCII over RS-232, or behind a serial-to-Ethernet box.

Not tried on hardware. Commands and bits of the mode: PyMeasure (thermotron3800.py), see
`benchctl_instruments.protocols.thermotron`; what all Thermotron drivers do is in `chambers.thermotron`. Commands are
not answered and need a second each; a set point is taken over at the next RUNM. Public sources name no query of alarms
and no ramp: a chamber that left manual mode is the only alarm.
"""

from __future__ import annotations

import math

from benchctl_instruments.chambers.thermotron import Thermotron, recognition_of
from benchctl_instruments.interfaces import ChamberReading, Identity
from benchctl_instruments.protocols import thermotron

AFTER_COMMAND_S = 1.0


class Thermotron3800(Thermotron):
    """Driver of a chamber with a Thermotron 3800. Not tried on hardware. Parameters: see `Thermotron`; power is NaN."""

    recognition = recognition_of("3800")
    NAME, COMMANDS_ANSWERED = "Thermotron 3800", False

    def identify(self) -> Identity:
        """Return the controller's name."""
        return Identity(manufacturer="Thermotron", model=self._ask(thermotron.IDENTITY, str))

    def start(self) -> None:
        """Run in manual mode, with the last set point. Raises `InstrumentError` if a program is running."""
        if self._mode() & thermotron.OF_A_PROGRAM:
            self._refuse_program()
        self._run()
        self._switched_on = True

    def read(self) -> ChamberReading:
        """Return air temperature and set point; power is NaN, and the only alarm is that of a chamber that stopped."""
        return ChamberReading(
            temperature_c=self._air_c(),
            setpoint_c=self._setpoint_c(),
            power_percent=math.nan,
            alarms=self._left(on=self._runs()),
        )

    def _check_controller(self) -> None:
        self._air_c()
        self._setpoint_c()
        self._mode()

    def _put(self, setpoint_c: float) -> None:
        self._wanted_c = setpoint_c
        if self._runs():
            self._run()
        else:
            self._send_setpoint()

    def _run(self) -> None:
        self._send_setpoint()
        self._tell(thermotron.RUN)
        self._confirm_running(on=True)
        self._confirm_setpoint()

    def _mode(self) -> int:
        return self._ask(thermotron.MODE, thermotron.read_code)

    def _runs(self) -> bool:
        return bool(self._mode() & thermotron.MANUAL)

    def _tell(self, command: str) -> None:
        self._lines.tell(command, repeatable=True)
        self._clock.sleep(AFTER_COMMAND_S)


Driver = Thermotron3800
