"""What all chambers behind a Modbus controller do alike.

| hook                   | default      | a controller's driver overrides it to                                  |
|------------------------|--------------|------------------------------------------------------------------------|
| `_check_controller()`  | (must)       | make sure, once connected, that the right controller answers           |
| `_switch(on)`          | (must)       | turn conditioning on or off, confirmed                                 |
| `identify()`           | (must)       | say who it is                                                          |
| `read()`               | (must)       | read air, set point, power, alarms                                     |
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Self

from benchctl_instruments.chambers.quantities import Quantity, QuantityTable
from benchctl_instruments.errors import BenchError, InstrumentError, UsageError
from benchctl_instruments.interfaces import ChamberReading, Identity
from benchctl_instruments.links.modbus import ModbusLink


class ModbusChamber(ABC):
    """A chamber whose set point and set point limits are quantities in registers.

    Parameters
    ----------
    link
        The controller, not yet connected.
    table
        Its quantities.
    setpoint, low_limit, high_limit
        Rows of the table, all in °C.
    """

    def __init__(
        self, link: ModbusLink, table: QuantityTable, *, setpoint: Quantity, low_limit: Quantity, high_limit: Quantity
    ) -> None:
        self._link = link
        self._table = table
        self._setpoint = setpoint
        self._low_limit = low_limit
        self._high_limit = high_limit

    def open(self) -> None:
        """Connect and make sure that the right controller answers."""
        self._link.open()
        try:
            self._check_controller()
            low_c, high_c = self._limits()
            if low_c >= high_c:
                raise InstrumentError(
                    f"{self._link.who}: its set point limits read {low_c:g} and {high_c:g} °C, low not below high;"
                    " check that it is the right model"
                )
        except BenchError:
            self._link.close()
            raise

    def close(self) -> None:
        """Let go of the link; safe to call twice, and never raises."""
        self._link.close()

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Program the controller's own set point limits, in an order in which low never passes high."""
        if not low_c < high_c:
            raise UsageError(f"{self._link.who}: set point limits {low_c:g} to {high_c:g} °C; give the lower one first")
        _, present_high_c = self._limits()
        writes = [(self._low_limit, low_c), (self._high_limit, high_c)]
        if low_c >= present_high_c:
            writes.reverse()
        for quantity, value in writes:
            self._table.put(quantity, value)

    def start(self) -> None:
        """Conditioning on."""
        self._switch(on=True)

    def stop(self) -> None:
        """Conditioning off; the set point stays as it is."""
        self._switch(on=False)

    def go_to(self, setpoint_c: float) -> None:
        """A new set point within the controller's limits, confirmed; the air follows within the chamber's ramp."""
        low_c, high_c = self._limits()  # as its registers keep them: 85.1 °C may be 85.0999985, or 85
        if not (math.isfinite(setpoint_c) and low_c <= self._table.kept(self._setpoint, setpoint_c) <= high_c):
            raise UsageError(
                f"{self._link.who}: set point {setpoint_c:g} °C lies outside"
                f" the controller's limits {low_c:g} to {high_c:g} °C"
            )
        self._table.put(self._setpoint, setpoint_c)

    @abstractmethod
    def identify(self) -> Identity:
        """Who it is."""

    @abstractmethod
    def read(self) -> ChamberReading:
        """Air, set point, power, alarms now."""

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    @abstractmethod
    def _check_controller(self) -> None: ...

    @abstractmethod
    def _switch(self, *, on: bool) -> None: ...

    def _limits(self) -> tuple[float, float]:
        limits = self._table.read_together((self._low_limit, self._high_limit))
        return limits[self._low_limit.name], limits[self._high_limit.name]
