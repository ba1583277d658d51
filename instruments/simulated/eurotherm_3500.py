"""A simulated chamber with a Eurotherm 3500 series controller, served as Modbus RTU."""

from __future__ import annotations

from instruments.simulated.eurotherm import SimulatedEurotherm
from instruments.simulated.machines import ChamberMachine


class SimulatedEurotherm3500(SimulatedEurotherm):
    """A Eurotherm 3508, from `start()` to `stop()` or in a `with`; a driver takes its `address`.

    It takes the output of manual mode at parameter 276. See `SimulatedEurotherm` for the keywords.
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
            chamber, manual_output=276, decimals=decimals, unit_id=unit_id, pace_baud=pace_baud, over_tcp=over_tcp
        )


Twin = SimulatedEurotherm3500
