"""A simulated chamber with a Eurotherm 2400 series controller, served as Modbus RTU.

Parameters: hailegroup/nupylab (eurotherm2000), AERCO manual OMM-0069 page 101; status word 75 recalled.
"""

from __future__ import annotations

from typing import ClassVar

from benchctl_instruments.simulated.eurotherm import SimulatedEurotherm
from benchctl_instruments.simulated.modbus_server import Register, word

SENSOR_BROKEN = 5  # bit of the status word
PROGRAM_STATES = (1, 2, 4, 8, 16)  # reset, running, held, holdback, ended


class SimulatedEurotherm2400(SimulatedEurotherm):
    """A Eurotherm 2400, from `start()` to `stop()` or in a `with`; a driver uses its `address`.

    It has a register for the sensor break (258), takes the output of manual mode at parameter 3, and has two set points
    and one program of 16 segments, which does not advance. See `SimulatedEurotherm` for the keywords.
    """

    PROCESS_VALUES = (1, 289)
    OUTPUT = MANUAL_OUTPUT = 3
    # alarms 1 and 2; remote set point, rate limit; highest, lowest, mean temperature; target and rate of the segment,
    # set point of the program; second input
    KEPT: ClassVar = {13: 185.0, 14: 190.0, **dict.fromkeys((26, 35, 133, 134, 135, 160, 161, 163, 290), 0.0)}
    # program; type and time left of its segment, segment, time and cycles left; customer's number; programs 0 (the
    # running one) and 1, of 17 times 8 parameters; then how many segments, programs, and set points less one
    KEPT_WHOLE: ClassVar = {22: 1, **dict.fromkeys((29, 36, 56, 58, 59, 629, *range(8192, 8192 + 2 * 136)), 0)} | {
        211: 16,
        517: 1,
        521: 1,
    }

    def _registers(self) -> list[Register]:
        return [
            *super()._registers(),
            word(23, lambda: self.program, self._set_program, takes=PROGRAM_STATES),
            word(75, lambda: self.alarms | int(self.sensor_broken) << SENSOR_BROKEN),
            word(258, lambda: int(self.sensor_broken)),
        ]

    def _set_program(self, state: int) -> None:
        self.program = state


Twin = SimulatedEurotherm2400
