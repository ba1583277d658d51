"""A simulated chamber with a Eurotherm 3500 series controller, served as Modbus RTU.

Parameters: MinimalModbus 0.5 (eurotherm3500.py); 1 and 276 lapkindm/eurotherm2000 (3508).
"""

from __future__ import annotations

from typing import ClassVar

from benchctl_instruments.simulated.eurotherm import SimulatedEurotherm
from benchctl_instruments.simulated.modbus_server import Register, word


class SimulatedEurotherm3500(SimulatedEurotherm):
    """A Eurotherm 3508, from `start()` to `stop()` or in a `with`; a driver uses its `address`.

    It takes the output of manual mode at parameter 276. Its second loop and its modules 3, 4 and 6 are not wired. See
    `SimulatedEurotherm` for the keywords.
    """

    PROCESS_VALUES = (1, 289)
    OUTPUT, MANUAL_OUTPUT = 85, 276
    # rate limit of the set point; modules 3, 4, 6; loop 2: set point, output, process value; alarm 1
    KEPT: ClassVar = {**dict.fromkeys((35, 370, 373, 379, 1029, 1109, 1313), 0.0), 10241: 185.0}
    KEPT_WHOLE: ClassVar = {78: 1, 268: 0}  # the rate limit is disabled; the loop is not inhibited

    def _registers(self) -> list[Register]:
        return [*super()._registers(), word(10213, lambda: int(self.alarms != 0 or self.sensor_broken))]


Twin = SimulatedEurotherm3500
