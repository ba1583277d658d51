"""What the simulated Eurotherm controllers have in common: parameters at two addresses over a chamber machine.

A parameter a answers as a scaled whole number at a and as a single at 2a + 32768, high word first. The target set point
lies in an EEPROM, and every write to it is counted, changed or not. Manual mode alone freezes the output as it is: the
chamber goes on until an output of zero is written.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from instruments.errors import UsageError
from instruments.protocols.modbus import ILLEGAL_VALUE, ModbusRefusal
from instruments.simulated.machines import ChamberMachine
from instruments.simulated.modbus_server import ModbusRtuServer
from instruments.simulated.registers import Register, RegisterTable, f32, signed_word, word

AUTO, MANUAL = 0, 1
SENSOR_BROKEN = 5  # bit of the status word
UPSCALE_C = 1372.0  # what it shows without a sensor
PROGRAM_RESET = 1


class SimulatedEurotherm(ModbusRtuServer):
    """A Eurotherm controller on a simulated line; its kinds differ in where the output of manual mode is written.

    Parameters
    ----------
    chamber
        What it controls.
    manual_output
        The parameter that takes the output of manual mode.
    decimals
        Digits behind the implied decimal point of the whole numbers, 0 to 2.
    unit_id
        Its Modbus address.
    pace_baud, over_tcp
        See `ModbusRtuServer`.

    `program` (parameter 23), `sensor_broken` and the alarm bits `alarms` may be set by hand; `eeprom_writes` counts.
    """

    def __init__(
        self,
        chamber: ChamberMachine,
        *,
        manual_output: int,
        decimals: int,
        unit_id: int,
        pace_baud: int | None,
        over_tcp: bool,
    ) -> None:
        if decimals not in (0, 1, 2):
            raise UsageError(f"decimals = {decimals}: a simulated Eurotherm has 0, 1 or 2")
        self._chamber = chamber
        self._decimals = decimals
        self._manual_output = manual_output
        self._mode = AUTO if chamber.running() else MANUAL
        self._frozen_percent = 0.0
        self._limits_c = (-200.0, 850.0)
        self.program = PROGRAM_RESET
        self.sensor_broken = False
        self.alarms = 0
        self.eeprom_writes = 0
        super().__init__(RegisterTable(self._registers()), unit_id=unit_id, pace_baud=pace_baud, over_tcp=over_tcp)

    def _registers(self) -> list[Register]:
        chamber = self._chamber
        manual = {self._manual_output: self._set_output}
        return [
            *self._parameter(1, self._air_c),
            *self._parameter(2, chamber.setpoint_c, self._set_setpoint),
            *self._parameter(3, self._output_percent, manual.get(3), decimals=1),
            *self._parameter(5, chamber.setpoint_c),
            *(self._parameter(276, self._output_percent, self._set_output, decimals=1) if 276 in manual else ()),
            word(23, lambda: self.program),
            word(75, lambda: self.alarms | int(self.sensor_broken) << SENSOR_BROKEN),
            word(273, lambda: self._mode, self._set_mode),
        ]

    def _parameter(
        self,
        number: int,
        get: Callable[[], float],
        put: Callable[[float], None] | None = None,
        *,
        decimals: int | None = None,
    ) -> tuple[Register, Register]:
        """Both addresses of a parameter."""
        step = 10 ** (self._decimals if decimals is None else decimals)
        whole = signed_word(
            number,
            lambda: max(-0x8000, min(0x7FFF, round(get() * step))),
            None if put is None else lambda value: put(value / step),
        )
        return whole, f32(2 * number + 0x8000, get, put)

    def _air_c(self) -> float:
        return UPSCALE_C if self.sensor_broken else self._chamber.air_c()

    def _set_setpoint(self, value_c: float) -> None:
        low_c, high_c = self._limits_c
        if not (math.isfinite(value_c) and low_c <= value_c <= high_c):
            raise ModbusRefusal(ILLEGAL_VALUE)
        self.eeprom_writes += 1
        self._chamber.set_setpoint(value_c)

    def _output_percent(self) -> float:
        return self._frozen_percent if self._mode == MANUAL else self._chamber.power_percent()

    def _set_mode(self, mode: int) -> None:
        if mode not in (AUTO, MANUAL):
            raise ModbusRefusal(ILLEGAL_VALUE)
        if mode == MANUAL and self._mode == AUTO:
            self._frozen_percent = self._chamber.power_percent()
        self._mode = mode
        if mode == AUTO:
            self._chamber.run(True)

    def _set_output(self, percent: float) -> None:
        if self._mode != MANUAL or not -100.0 <= percent <= 100.0:
            raise ModbusRefusal(ILLEGAL_VALUE)
        self._frozen_percent = percent
        self._chamber.run(percent != 0.0)
