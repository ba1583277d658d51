"""A simulated chamber with a Eurotherm 2400 series controller, served as Modbus RTU."""

from __future__ import annotations

from instruments.simulated.eurotherm import SimulatedEurotherm
from instruments.simulated.machines import ChamberMachine
from instruments.simulated.registers import Register, word


class SimulatedEurotherm2400(SimulatedEurotherm):
    """A Eurotherm 2400, from `start()` to `stop()` or in a `with`; a driver takes its `address`.

    It has a register for the sensor break by itself (258), and takes the output of manual mode at parameter 3. See
    `SimulatedEurotherm` for the keywords.
    """

    def __init__(
        self,
        chamber: ChamberMachine,
        *,
        decimals: int = 1,
        unit_id: int = 1,
        pace_baud: int | None = None,
        over_tcp: bool = False,
    ) -> None:
        super().__init__(
            chamber, manual_output=3, decimals=decimals, unit_id=unit_id, pace_baud=pace_baud, over_tcp=over_tcp
        )

    def _registers(self) -> list[Register]:
        return [*super()._registers(), word(258, lambda: int(self.sensor_broken))]


Twin = SimulatedEurotherm2400
