"""What all chambers behind a Modbus controller do alike, and what such a controller keeps in its registers.

| hook                   | default      | a controller's driver overrides it to                                  |
|------------------------|--------------|------------------------------------------------------------------------|
| `_check_controller()`  | (must)       | make sure, once connected, that the right controller answers           |
| `_switch(on)`          | (must)       | turn conditioning on or off, confirmed                                 |
| `identify()`           | (must)       | say who it is                                                          |
| `read()`               | (must)       | read air, set point, power, alarms                                     |

Its quantities are declared in a table, and read and written the same way. A driver declares its quantities in a table
and never packs or scales a number itself. A write is never trusted: it is read back until the controller shows what it
was told, or an error says what it shows instead.
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
PLAUSIBLE_C = (1e-6, 1e4)  # in the wrong word order 25.0 comes as 2.4e-41, and 200.3 as 1.1e8


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """One row of a controller's table.

    `kind` is "code" (an unsigned whole number that stands for something), "signed" (two's complement with an implied
    decimal point) or "f32". `decimals` are the digits behind the implied point; None: as many as the controller is set
    to.
    """

    name: str
    address: int
    kind: Kind
    unit: str = ""
    decimals: int | None = None
    writable: bool = False


class QuantityTable:
    """Reads and writes declared quantities of one unit.

    Parameters
    ----------
    link
        The unit.
    clock
        Where waiting for a confirmation takes place.
    word_order
        Of 32-bit numbers.

    `decimals` is what the controller's own implied decimal point is worth; set it before scaled quantities are used.
    """

    def __init__(self, link: ModbusLink, *, clock: Clock, word_order: WordOrder = "high_first") -> None:
        self._link = link
        self._clock = clock
        self._word_order: WordOrder = word_order
        self.decimals = 0

    def read(self, quantity: Quantity) -> float:
        """One quantity, in its unit."""
        return self._value(quantity, self._link.read(quantity.address, WORDS[quantity.kind]))

    def read_code(self, quantity: Quantity) -> int:
        """One quantity that is a code."""
        return int(self.read(quantity))

    def read_together(self, quantities: Iterable[Quantity]) -> dict[str, float]:
        """Several quantities by name; those in neighbouring registers come with one request."""
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
        """Write, without looking whether it had any effect."""
        if not quantity.writable:
            raise UsageError(
                f"{self._link.who}: {quantity.name} (register {quantity.address}) can only be read; leave it as it is"
            )
        self._link.write(quantity.address, self._words(quantity, value), once=once)

    def put(self, quantity: Quantity, value: float) -> None:
        """Write, then read back until it is there; a value between two steps of the register goes to the nearer one."""
        self.write(quantity, value)
        self.confirm(quantity, self.kept(quantity, value))

    def kept(self, quantity: Quantity, value: float) -> float:
        """What the register will hold of a value: the nearest that it can state."""
        return self._decoded(quantity, self._words(quantity, value))

    def confirm(self, quantity: Quantity, value: float) -> None:
        """Wait a little, in bench time, until a quantity has a value; else `InstrumentError` says which it has."""
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
    """Quantities, ordered by address, parted where a register that is none of theirs lies between two."""
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

    @abstractmethod
    def _check_controller(self) -> None: ...

    @abstractmethod
    def _switch(self, *, on: bool) -> None: ...

    def _limits(self) -> tuple[float, float]:
        limits = self._table.read_together((self._low_limit, self._high_limit))
        return limits[self._low_limit.name], limits[self._high_limit.name]
