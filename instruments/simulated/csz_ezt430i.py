"""A simulated chamber with a CSZ EZT-430i controller: its registers over a chamber machine, served as Modbus RTU."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from instruments.errors import UsageError
from instruments.protocols.modbus import ILLEGAL_VALUE, ModbusRefusal
from instruments.simulated.machines import ChamberMachine
from instruments.simulated.modbus_server import ModbusRtuServer
from instruments.simulated.registers import Register, RegisterTable, signed_word, word

EVENTS = 0x3F  # six system events
MOST_DECIMALS = 3
SENSOR_BREAK = 39
LOW_C, HIGH_C = -80.0, 200.0
ALARM_C = 190.0


class SimulatedCszEzt430i(ModbusRtuServer):
    """A CSZ EZT-430i on a simulated line, from `start()` to `stop()` or in a `with`; a driver takes its `address`.

    Parameters
    ----------
    chamber
        What it controls.
    decimals
        Digits behind the implied decimal point, 0 to 3.
    on_event
        The system event wired to conditioning, 1 to 6.
    unit_id, pace_baud, over_tcp
        See `ModbusRtuServer`.

    Air above 190 °C latches its input alarm (register 5), until register 1 resets it with the air back below. `busy`
    (register 0), `events` (12), `manual_override` (9), `program` (15) and `loop_error` (39) may be set by hand;
    `reserved_writes` counts what was written to register 11.
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
        self._step = 10**decimals
        self._on_bit = 1 << (on_event - 1)
        self._latched = 0
        self.busy = 0
        self.events = self._on_bit if chamber.running() else 0
        self.manual_override = 0
        self.program = 0
        self.loop_error = 0
        self.reserved_writes = 0
        registers = EztRegisters(self._registers(), is_busy=lambda: self.busy != 0)
        super().__init__(registers, unit_id=unit_id, pace_baud=pace_baud, over_tcp=over_tcp)

    def _registers(self) -> list[Register]:
        chamber = self._chamber
        return [
            word(0, lambda: self.busy),
            word(1, lambda: 0, self._reset_alarms),
            word(2, lambda: 0),
            word(3, lambda: 0),
            word(4, lambda: 0),
            word(5, self._input_alarm),
            word(9, lambda: self.manual_override),
            word(10, lambda: 0),
            word(11, lambda: 0, self._touch_reserved),
            word(12, lambda: self.events, self._set_events),
            word(15, lambda: self.program),
            self._scaled(35, lambda: float("inf") if self.loop_error == SENSOR_BREAK else chamber.air_c()),
            self._scaled(36, chamber.setpoint_c, self._set_setpoint),
            signed_word(37, lambda: round(100 * chamber.power_percent())),
            word(38, lambda: 0),
            word(39, lambda: self.loop_error),
        ]

    def _scaled(self, address: int, get: Callable[[], float], put: Callable[[float], None] | None = None) -> Register:
        """A temperature with the implied decimal point, at the end of its range where it does not fit."""
        return signed_word(
            address,
            lambda: round(max(-0x8000, min(0x7FFF, get() * self._step))),
            None if put is None else lambda value: put(value / self._step),
        )

    def _input_alarm(self) -> int:
        if self._chamber.air_c() > ALARM_C:
            self._latched = 1
        return self._latched

    def _reset_alarms(self, value: int) -> None:
        if value not in (0, 1):
            raise ModbusRefusal(ILLEGAL_VALUE)
        if value == 1:
            self._latched = 0

    def _touch_reserved(self, _: int) -> None:
        self.reserved_writes += 1

    def _set_events(self, events: int) -> None:
        if events & ~EVENTS:
            raise ModbusRefusal(ILLEGAL_VALUE)
        self.events = events
        self._chamber.run(bool(events & self._on_bit))

    def _set_setpoint(self, value_c: float) -> None:
        if not LOW_C <= value_c <= HIGH_C:
            raise ModbusRefusal(ILLEGAL_VALUE)
        self._chamber.set_setpoint(value_c)


class EztRegisters(RegisterTable):
    """The EZT-430i's registers, one at a time: several at once are acknowledged, and nothing is done.

    A real one treats function 16 so whatever the number of registers; here one register with function 16 is written.
    While it is busy nothing is done either, which is assumed.
    """

    def __init__(self, registers: Iterable[Register], *, is_busy: Callable[[], bool]) -> None:
        self._is_busy = is_busy
        super().__init__(registers)

    def write(self, address: int, values: list[int]) -> None:
        """Write one register."""
        if len(values) == 1 and not self._is_busy():
            super().write(address, values)


Twin = SimulatedCszEzt430i
