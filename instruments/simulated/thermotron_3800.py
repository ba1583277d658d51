"""A simulated chamber with a Thermotron 3800, as PyMeasure's client describes it. INIT stops it."""

from __future__ import annotations

from benchctl_instruments.protocols import thermotron
from benchctl_instruments.simulated.machines import ChamberMachine
from benchctl_instruments.simulated.serial_line import LineServer
from benchctl_instruments.simulated.thermotron import ThermotronController


class Controller3800(ThermotronController):
    """The states of a 3800: a set point waits for the next RUNM in every mode."""

    NAME = "3800 SIMULATED"
    COMMANDS_ANSWERED = False

    def __init__(self, chamber: ChamberMachine) -> None:
        super().__init__(chamber)
        self._queries[thermotron.MODE] = lambda: str(self._mode())
        self._commands["INIT"] = self._stop

    def _mode(self) -> int:
        if self.program:
            return thermotron.PROGRAM
        return thermotron.MANUAL if self._chamber.running() else thermotron.STOPPED

    def _look_at_air(self) -> None:
        """It has no alarms that a computer could read."""


class SimulatedThermotron3800(LineServer):
    """A 3800 on a serial line, or over TCP as behind a box; keywords as for `LineServer`.

    `controller` provides what happens at the chamber.
    """

    def __init__(self, chamber: ChamberMachine, *, over_tcp: bool = False, pace_baud: int | None = None) -> None:
        self.controller = Controller3800(chamber)
        super().__init__(self.controller.execute, over_tcp=over_tcp, pace_baud=pace_baud)


Twin = SimulatedThermotron3800
