"""A simulated chamber with a Thermotron 8800. Air beyond -80 or 185 °C stops it with a process alarm."""

from __future__ import annotations

from benchctl_instruments.protocols import thermotron
from benchctl_instruments.protocols.thermotron import value_line
from benchctl_instruments.simulated.machines import ChamberMachine
from benchctl_instruments.simulated.serial_line import LineServer
from benchctl_instruments.simulated.thermotron import HIGHEST_C, LOWEST_C, ThermotronController

BEYOND_C = 5.0
LOW_ALARM, HIGH_ALARM = thermotron.PROCESS_ALARMS


class Controller8800(ThermotronController):
    """The states of an 8800. The ramp is stored, and does not slow the air, which has the machine's own.

    `stop_code` is the cause of its last stop.
    """

    NAME = "8800 SIMULATED"
    COMMANDS_ANSWERED = True

    def __init__(self, chamber: ChamberMachine) -> None:
        super().__init__(chamber)
        self.stop_code = 0
        self._alarm = 0
        self._ramp_c_per_min = 0.0
        self._queries |= {
            thermotron.VERSION: lambda: "1.00",
            thermotron.STOP_CODE: lambda: str(thermotron.RUNNING if chamber.running() else self.stop_code),
            thermotron.ALARM: lambda: str(self._alarm),
            thermotron.THROTTLE: lambda: value_line(chamber.power_percent()),
            thermotron.query(thermotron.RAMP): lambda: value_line(self._ramp_c_per_min),
        }
        self._settings[thermotron.RAMP] = self._set_ramp

    def _set_setpoint(self, setpoint_c: float) -> None:
        super()._set_setpoint(setpoint_c)
        if self._chamber.running():
            self._take_over()

    def _set_ramp(self, ramp_c_per_min: float) -> None:
        self._ramp_c_per_min = ramp_c_per_min

    def _run(self) -> None:
        super()._run()
        self._alarm = 0

    def _stop(self) -> None:
        self.stop_code = thermotron.BY_COMPUTER
        super()._stop()

    def _look_at_air(self) -> None:
        air_c = self._chamber.air_c()
        if self._chamber.running() and not LOWEST_C - BEYOND_C <= air_c <= HIGHEST_C + BEYOND_C:
            self._stop()
            self.stop_code = thermotron.BY_PROCESS_ALARM
            self._alarm = HIGH_ALARM if air_c > HIGHEST_C else LOW_ALARM


class SimulatedThermotron8800(LineServer):
    """An 8800 at `tcp://host:port`, or on a serial line; keywords as for `LineServer`.

    `controller` provides what happens at the chamber.
    """

    def __init__(self, chamber: ChamberMachine, *, over_tcp: bool = True, pace_baud: int | None = None) -> None:
        self.controller = Controller8800(chamber)
        super().__init__(self.controller.execute, over_tcp=over_tcp, pace_baud=pace_baud)


Twin = SimulatedThermotron8800
