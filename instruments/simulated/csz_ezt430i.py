"""A simulated chamber with a CSZ EZT-430i controller: its registers over a chamber machine, served as Modbus RTU.

Registers: EZT-430i Communications Manual, revision C, pages 4.8 to 5.7. Its second loop has no machine, and a program
is stored but not run. Function 16 is acknowledged but executed for programs only, as on a real one.
"""

from __future__ import annotations

from benchctl_instruments.errors import UsageError
from benchctl_instruments.protocols.modbus import WRITE_SEVERAL, Request
from benchctl_instruments.simulated.machines import ChamberMachine
from benchctl_instruments.simulated.modbus_server import (
    LimitedSetpoint,
    ModbusRtuServer,
    Register,
    RegisterTable,
    constants,
    laid_out,
    scaled,
    signed_word,
    word,
)

EVENTS = 6
MOST_DECIMALS = 3
SENSOR_BREAK = 39
ALARM_C = 190.0
PROGRAM, PROGRAM_WORDS = 100, 14 * 65  # a head and 64 steps
MEMORY = {
    10: (0,),  # autotune
    14: (1,),  # first step of the program
    41: (500, 0),  # loop 2: set point, output
    51: (1900,) * 6,  # set points of the alarms
    PROGRAM: (0,) * PROGRAM_WORDS,
}
CONSTANTS = {
    2: (0, 0, 0),  # alarms: program out of step, communication of a loop, control of a loop
    16: (0,) * 12,  # program: name, step, steps, time of the step, time left, cycles left
    31: (0, 0),  # targets of the step
    38: (0,),  # loop 1: mode
    40: (500,),  # loop 2: process value
    43: (0, 0),  # mode, error
}


class SimulatedCszEzt430i(ModbusRtuServer):
    """A CSZ EZT-430i on a simulated line, from `start()` to `stop()` or in a `with`; a driver uses its `address`.

    Parameters
    ----------
    chamber
        The chamber machine.
    decimals
        Digits after the implied decimal point, 0 to 3.
    on_event
        The system event wired to conditioning, 1 to 6.
    unit_id, pace_baud, over_tcp
        See `ModbusRtuServer`.

    Air above 190 °C latches its input alarm (register 5), until register 1 resets it with the air back below. `busy`
    (register 0), `events` (12), `manual_override` (9), `program` (15) and `loop_error` (39) may be assigned; while it
    is busy no write is executed, which is an assumption. `reserved_writes` counts the writes to register 11.
    """

    def __init__(
        self,
        chamber: ChamberMachine,
        *,
        decimals: int = 1,
        on_event: int = 1,
        unit_id: int = 1,
        pace_baud: int | None = None,
        over_tcp: bool = False,
    ) -> None:
        if not 0 <= decimals <= MOST_DECIMALS:
            raise UsageError(f"decimals = {decimals}: a simulated EZT-430i has 0 to {MOST_DECIMALS}")
        self._chamber = chamber
        self._decimals = decimals
        self._on_bit = 1 << (on_event - 1)
        self._latched = 0
        self.busy = 0
        self.events = self._on_bit if chamber.running() else 0
        self.manual_override = 0
        self.program = 0
        self.loop_error = 0
        self.reserved_writes = 0
        registers = RegisterTable(self._registers(), memory=laid_out(MEMORY))
        super().__init__(registers, unit_id=unit_id, pace_baud=pace_baud, over_tcp=over_tcp, ignores=self._ignores)

    def _registers(self) -> list[Register]:
        chamber = self._chamber
        setpoint = LimitedSetpoint(chamber, -80.0, 200.0)
        return [
            *constants(laid_out(CONSTANTS)),
            word(0, lambda: self.busy),
            word(1, lambda: 0, self._reset_alarms, takes=(0, 1)),
            word(5, self._input_alarm),
            word(9, lambda: self.manual_override),
            word(11, lambda: 0, self._touch_reserved),
            word(12, lambda: self.events, self._set_events, takes=range(1 << EVENTS)),
            word(15, lambda: self.program),
            scaled(
                35,
                lambda: float("inf") if self.loop_error == SENSOR_BREAK else chamber.air_c(),
                decimals=self._decimals,
            ),
            scaled(36, chamber.setpoint_c, setpoint.put, decimals=self._decimals),
            signed_word(37, lambda: round(100 * chamber.power_percent())),
            word(39, lambda: self.loop_error),
        ]

    def _ignores(self, request: Request) -> bool:
        return self.busy != 0 or (request.function == WRITE_SEVERAL and request.address < PROGRAM)

    def _input_alarm(self) -> int:
        if self._chamber.air_c() > ALARM_C:
            self._latched = 1
        return self._latched

    def _reset_alarms(self, value: int) -> None:
        if value == 1:
            self._latched = 0

    def _touch_reserved(self, _: int) -> None:
        self.reserved_writes += 1

    def _set_events(self, events: int) -> None:
        self.events = events
        self._chamber.run(bool(events & self._on_bit))


Twin = SimulatedCszEzt430i
