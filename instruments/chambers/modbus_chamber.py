"""The common part of the drivers of chambers with a Modbus controller, and its table of quantities in registers.

| hook                   | default      | a controller's driver overrides it to                                  |
|------------------------|--------------|------------------------------------------------------------------------|
| `_check_controller()`  | (required)   | check after connecting that the right controller answers               |
| `_switch(on)`          | (required)   | switch conditioning on or off, confirmed                               |
| `identify()`           | (required)   | return the controller's identity                                       |
| `read()`               | (required)   | read air, set point, power, alarms                                     |

A driver declares its quantities in a table and never packs or scales a number itself. Every write is confirmed: it is
read back until the controller shows the written value; otherwise an error reports the value that it shows.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from benchctl_instruments.errors import BenchError, InstrumentError, UsageError
from benchctl_instruments.interfaces import ChamberReading, Clock, Identity, Instrument
from benchctl_instruments.links.modbus import ModbusLink
from benchctl_instruments.protocols.modbus import (
    WordOrder,
    f32_from_words,
    signed_from_word,
    word_from_signed,
    words_from_f32,
)

Kind = Literal["code", "signed", "f32"]
WORDS: dict[Kind, int] = {"code": 1, "signed": 1, "f32": 2}

CONFIRM_S, LOOK_AGAIN_S = 2.0, 0.1
F32_TOLERANCE = 0.01
PLAUSIBLE_C = (1e-6, 1e4)  # 25.0 in the wrong word order reads as 2.4e-41, and 200.3 as 1.1e8


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """One row of a controller's table.

    `kind` is "code" (an unsigned integer code), "signed" (two's complement with an implied decimal point) or "f32".
    `decimals` is the number of digits after the implied point; None: the number set on the controller.
    """

    name: str
    address: int
    kind: Kind
    unit: str = ""
    decimals: int | None = None
    writable: bool = False


class QuantityTable:
    """Read and write the declared quantities of one Modbus unit.

    Parameters
    ----------
    link
        The link to the unit.
    clock
        The clock used while waiting for a confirmation.
    word_order
        Word order of 32-bit numbers.

    `decimals` is the controller's own implied decimal point; set it before using scaled quantities.
    """

    def __init__(self, link: ModbusLink, *, clock: Clock, word_order: WordOrder = "high_first") -> None:
        self._link = link
        self._clock = clock
        self._word_order: WordOrder = word_order
        self.decimals = 0

    def read(self, quantity: Quantity) -> float:
        """Return one quantity in its unit."""
        return self._value(quantity, self._link.read(quantity.address, WORDS[quantity.kind]))

    def read_code(self, quantity: Quantity) -> int:
        """Return one quantity that is a code."""
        return int(self.read(quantity))

    def read_together(self, quantities: Iterable[Quantity]) -> dict[str, float]:
        """Return several quantities by name; those in neighbouring registers are read with one request."""
        ordered = sorted(quantities, key=lambda quantity: quantity.address)
        values: dict[str, float] = {}
        for run in _runs(ordered):
            first = run[0].address
            words = self._link.read(first, run[-1].address + WORDS[run[-1].kind] - first)
            for quantity in run:
                start = quantity.address - first
                values[quantity.name] = self._value(quantity, words[start : start + WORDS[quantity.kind]])
        return values

    def write(self, quantity: Quantity, value: float, *, once: bool = False) -> None:
        """Write a value without reading it back."""
        if not quantity.writable:
            raise UsageError(
                f"{self._link.who}: {quantity.name} (register {quantity.address}) can only be read; leave it as it is"
            )
        self._link.write(quantity.address, self._words(quantity, value), once=once)

    def put(self, quantity: Quantity, value: float) -> None:
        """Write a value, rounded to the register's nearest step, and read back until the register holds it."""
        self.write(quantity, value)
        self.confirm(quantity, self.kept(quantity, value))

    def kept(self, quantity: Quantity, value: float) -> float:
        """Return the value rounded to the nearest one that the register can hold."""
        return self._decoded(quantity, self._words(quantity, value))

    def confirm(self, quantity: Quantity, value: float) -> None:
        """Wait briefly, in bench time, until a quantity has a value; otherwise raise `InstrumentError`."""
        tolerance = F32_TOLERANCE if quantity.kind == "f32" else 0.0
        started_s = self._clock.now()
        while abs((shown := self.read(quantity)) - value) > tolerance:
            if self._clock.now() - started_s >= CONFIRM_S:
                raise InstrumentError(
                    f"{self._link.who}: {quantity.name} (register {quantity.address}) should be"
                    f" {_in_unit(value, quantity)} and still reads {_in_unit(shown, quantity)} after {CONFIRM_S:g} s;"
                    " check that no profile or other program sets it, and that the panel is not locked"
                )
            self._clock.sleep(LOOK_AGAIN_S)

    def _words(self, quantity: Quantity, value: float) -> list[int]:
        if not math.isfinite(value):
            raise UsageError(f"{self._link.who}: {quantity.name} cannot be set to {value}")
        try:
            if quantity.kind == "f32":
                return words_from_f32(value, self._word_order)
            if quantity.kind == "signed":
                return [word_from_signed(round(value * 10.0 ** self._digits(quantity)))]
        except (ValueError, OverflowError) as err:
            raise UsageError(
                f"{self._link.who}: {quantity.name} cannot be set to {_in_unit(value, quantity)}:"
                f" its register ({quantity.kind}) does not reach so far; give one that it can hold"
            ) from err
        return [round(value)]

    def _value(self, quantity: Quantity, words: list[int]) -> float:
        value = self._decoded(quantity, words)
        implausible = value != 0 and not PLAUSIBLE_C[0] <= abs(value) <= PLAUSIBLE_C[1]
        if quantity.kind == "f32" and quantity.unit == "°C" and implausible:
            other = "high_first" if self._word_order == "low_first" else "low_first"
            raise InstrumentError(
                f"{self._link.who}: {quantity.name} (register {quantity.address}) reads {value:.3g} {quantity.unit},"
                f" which makes no sense; its words may come in the other order, try word_order = {other!r}"
            )
        return value

    def _decoded(self, quantity: Quantity, words: list[int]) -> float:
        if quantity.kind == "code":
            return words[0]
        if quantity.kind == "signed":
            return signed_from_word(words[0]) / 10.0 ** self._digits(quantity)
        return f32_from_words(words, self._word_order)

    def _digits(self, quantity: Quantity) -> int:
        return self.decimals if quantity.decimals is None else quantity.decimals


def _runs(ordered: list[Quantity]) -> list[list[Quantity]]:
    """Split quantities, ordered by address, into runs without unused registers between them."""
    runs: list[list[Quantity]] = []
    for quantity in ordered:
        last = runs[-1][-1] if runs else None
        if last is not None and last.address + WORDS[last.kind] == quantity.address:
            runs[-1].append(quantity)
        else:
            runs.append([quantity])
    return runs


def _in_unit(value: float, quantity: Quantity) -> str:
    return f"{value:g} {quantity.unit}".rstrip()


class ModbusChamber(Instrument, ABC):
    """Driver of a chamber whose set point and set point limits are quantities in registers.

    Parameters
    ----------
    link
        The link to the controller, not yet connected.
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
        """Connect and check that the right controller answers."""
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
        """Close the link; safe to call twice, and never raises."""
        self._link.close()

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Program the controller's own set point limits, in an order in which low never exceeds high."""
        if not low_c < high_c:
            raise UsageError(f"{self._link.who}: set point limits {low_c:g} to {high_c:g} °C; give the lower one first")
        _, present_high_c = self._limits()
        writes = [(self._low_limit, low_c), (self._high_limit, high_c)]
        if low_c >= present_high_c:
            writes.reverse()
        for quantity, value in writes:
            self._table.put(quantity, value)

    def start(self) -> None:
        """Switch conditioning on."""
        self._switch(on=True)

    def stop(self) -> None:
        """Switch conditioning off; the set point does not change."""
        self._switch(on=False)

    def go_to(self, setpoint_c: float) -> None:
        """Set a set point within the controller's limits and confirm it; the air follows within the chamber's ramp."""
        low_c, high_c = self._limits()  # as stored in the registers: 85.1 °C may be 85.0999985, or 85
        if not (math.isfinite(setpoint_c) and low_c <= self._table.kept(self._setpoint, setpoint_c) <= high_c):
            raise UsageError(
                f"{self._link.who}: set point {setpoint_c:g} °C lies outside"
                f" the controller's limits {low_c:g} to {high_c:g} °C"
            )
        self._table.put(self._setpoint, setpoint_c)

    @abstractmethod
    def identify(self) -> Identity:
        """Return the controller's identity."""

    @abstractmethod
    def read(self) -> ChamberReading:
        """Return air temperature, set point, power and alarms."""

    @abstractmethod
    def _check_controller(self) -> None: ...

    @abstractmethod
    def _switch(self, *, on: bool) -> None: ...

    def _limits(self) -> tuple[float, float]:
        limits = self._table.read_together((self._low_limit, self._high_limit))
        return limits[self._low_limit.name], limits[self._high_limit.name]
