"""What a controller keeps in its registers, declared; read and written the same way for every quantity.

A driver declares its quantities in a table and never packs or scales a number itself. A write is never trusted: it is
read back until the controller shows what it was told, or an error says what it shows instead.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.interfaces import Clock
from benchctl_instruments.links.modbus import ModbusLink
from benchctl_instruments.protocols.words import (
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
