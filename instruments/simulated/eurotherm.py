"""The common part of the simulated Eurotherm controllers: parameters at two addresses over a chamber machine.

A parameter a is a scaled integer at a and a single at 2a + 32768, high word first. The set points are stored in an
EEPROM, and every write to one is counted, changed or not. Manual mode alone freezes the output: the chamber continues
until an output of zero is written.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import ClassVar

from benchctl_instruments.errors import UsageError
from benchctl_instruments.protocols.modbus import ILLEGAL_VALUE, ModbusRefusal
from benchctl_instruments.simulated.machines import ChamberMachine
from benchctl_instruments.simulated.modbus_server import (
    LimitedSetpoint,
    ModbusRtuServer,
    Register,
    RegisterTable,
    f32,
    scaled,
    word,
)

AUTO, MANUAL = 0, 1
UPSCALE_C = 1372.0  # reading without a sensor
PROGRAM_RESET = 1


class SimulatedEurotherm(ModbusRtuServer):
    """A Eurotherm controller on a simulated line; its series differ in their parameters.

    Parameters
    ----------
    chamber
        The chamber machine.
    decimals
        Digits after the implied decimal point of the integers, 0 to 2.
    unit_id, pace_baud, over_tcp
        See `ModbusRtuServer`.

    `program` (parameter 23), `sensor_broken` and the alarm bits `alarms` may be assigned; `eeprom_writes` counts
    writes.
    """

    PROCESS_VALUES: ClassVar[tuple[int, ...]]
    OUTPUT: ClassVar[int]
    MANUAL_OUTPUT: ClassVar[int]
    KEPT: ClassVar[Mapping[int, float]]
    """Parameters that store written values, with the controller's decimals."""
    KEPT_WHOLE: ClassVar[Mapping[int, float]]
    """Parameters that store written values, without decimals."""

    def __init__(
        self,
        chamber: ChamberMachine,
        *,
        decimals: int = 1,
        unit_id: int = 1,
        pace_baud: int | None = None,
        over_tcp: bool = False,
    ) -> None:
        if decimals not in (0, 1, 2):
            raise UsageError(f"decimals = {decimals}: a simulated Eurotherm has 0, 1 or 2")
        self._chamber = chamber
        self._decimals = decimals
        self._mode = AUTO if chamber.running() else MANUAL
        self._frozen_percent = 0.0
        self._setpoint = LimitedSetpoint(chamber, -200.0, 850.0)
        self._selected, self._other_c = 0, chamber.setpoint_c()  # parameter 15; of SP1 and SP2 the one not selected
        self._values = {**self.KEPT, **self.KEPT_WHOLE}
        self.program = PROGRAM_RESET
        self.sensor_broken = False
        self.alarms = 0
        self.eeprom_writes = 0
        super().__init__(RegisterTable(self._registers()), unit_id=unit_id, pace_baud=pace_baud, over_tcp=over_tcp)

    def _registers(self) -> list[Register]:
        chamber = self._chamber
        put = {self.MANUAL_OUTPUT: self._set_output}
        return [
            *(each for number in self.PROCESS_VALUES for each in self._parameter(number, self._air_c)),
            *self._parameter(2, chamber.setpoint_c, self._set_setpoint),
            *self._parameter(5, chamber.setpoint_c),
            word(15, lambda: self._selected, self._select, takes=(0, 1)),
            *self._parameter(24, lambda: self._setpoint_of(0), lambda value: self._set_setpoint_of(0, value)),
            *self._parameter(25, lambda: self._setpoint_of(1), lambda value: self._set_setpoint_of(1, value)),
            *(
                each
                for number in {self.OUTPUT, self.MANUAL_OUTPUT}
                for each in self._parameter(number, self._output_percent, put.get(number), decimals=1)
            ),
            word(273, lambda: self._mode, self._set_mode, takes=(AUTO, MANUAL)),
            *(each for number in self.KEPT for each in self._kept(number, None)),
            *(each for number in self.KEPT_WHOLE for each in self._kept(number, 0)),
        ]

    def _parameter(
        self,
        number: int,
        get: Callable[[], float],
        put: Callable[[float], None] | None = None,
        *,
        decimals: int | None = None,
    ) -> tuple[Register, Register]:
        """Return the registers of both addresses of a parameter."""
        integer = scaled(number, get, put, decimals=self._decimals if decimals is None else decimals)
        return integer, f32(2 * number + 0x8000, get, put)

    def _kept(self, number: int, decimals: int | None) -> tuple[Register, Register]:
        def put(value: float) -> None:
            if not math.isfinite(value):
                raise ModbusRefusal(ILLEGAL_VALUE)
            self._values[number] = value

        return self._parameter(number, lambda: self._values[number], put, decimals=decimals)

    def _air_c(self) -> float:
        return UPSCALE_C if self.sensor_broken else self._chamber.air_c()

    def _set_setpoint(self, value_c: float) -> None:
        self._setpoint.put(value_c)
        self.eeprom_writes += 1

    def _setpoint_of(self, which: int) -> float:
        return self._chamber.setpoint_c() if which == self._selected else self._other_c

    def _set_setpoint_of(self, which: int, value_c: float) -> None:
        if which == self._selected:
            self._set_setpoint(value_c)
        elif not math.isfinite(value_c):
            raise ModbusRefusal(ILLEGAL_VALUE)
        else:
            self.eeprom_writes += 1
            self._other_c = value_c

    def _select(self, which: int) -> None:
        if which != self._selected:
            before_c = self._chamber.setpoint_c()
            self._setpoint.put(self._other_c)
            self._selected, self._other_c = which, before_c

    def _output_percent(self) -> float:
        return self._frozen_percent if self._mode == MANUAL else self._chamber.power_percent()

    def _set_mode(self, mode: int) -> None:
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
