"""The registers of a controller that a profile declares: read in its runs, written with its functions.

Extends `QuantityTable` of the drivers written in Python by what profiles can declare: unsigned numbers with an implied
decimal point, codes that mark an invalid temperature, registers that wear out or cannot be read back, and limits for
which the controller has no registers, which are stored here.

A profile also declares how conditioning is switched on and off; each class for one way switches, confirms and reads the
state.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from benchctl_instruments.chambers.modbus_chamber import WORDS, Quantity, QuantityTable
from benchctl_instruments.chambers.profile import (
    AirTemperature,
    BitSwitch,
    KeySwitch,
    Number,
    Profile,
    RegisterSwitch,
    Setpoint,
    number_of,
)
from benchctl_instruments.errors import BenchError, InstrumentError, UsageError
from benchctl_instruments.interfaces import Clock
from benchctl_instruments.links.modbus import ModbusLink

WRITE_ONE = 6
NOWHERE = -1
"""The address of quantities stored in the table itself."""

ADVICE = "check the chamber's sensor and its wiring"


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfiledQuantity(Quantity):
    """A row of the table as a profile declares it.

    A "code" with `decimals` is an unsigned number; only the bits of `mask` of a code are compared. `invalid` are the
    numbers, as stored in the register, that mark an invalid temperature, and `valid` is the range of valid ones; with
    `wears` only a changed value is written; without `readable` nothing is read back.
    """

    mask: int = 0xFFFF
    readable: bool = True
    wears: bool = False
    invalid: Mapping[float, str] = field(default_factory=dict)
    valid: tuple[float, float] | None = None


def quantity_of(number: Number, name: str, unit: str, *, profile: Profile, writable: bool = False) -> ProfiledQuantity:
    """Return a number of a profile as a row of the table, by default with the controller's decimal point."""
    air = number if isinstance(number, AirTemperature) else None
    setpoint = number if isinstance(number, Setpoint) else None
    decimals = number.decimals
    if decimals is None and profile.decimals_register is None:
        decimals = profile.decimals
    return ProfiledQuantity(
        name=name,
        address=number.address,
        kind="code" if number.kind == "u16" else number.kind,
        unit=unit,
        decimals=decimals,
        writable=writable,
        readable=setpoint is None or setpoint.readable,
        wears=setpoint is not None and setpoint.wears,
        invalid={} if air is None else {number_of(key): text for key, text in air.invalid.items()},
        valid=None if air is None else air.valid_c,
    )


class ProfiledTable(QuantityTable):
    """A `QuantityTable` that follows a profile.

    Parameters
    ----------
    link
        The link to the controller.
    clock
        The clock used while waiting for a confirmation.
    profile
        The controller's profile.
    kept
        Quantities stored here and in no register, by name, with their initial values.
    """

    def __init__(self, link: ModbusLink, *, clock: Clock, profile: Profile, kept: Mapping[str, float]) -> None:
        super().__init__(link, clock=clock, word_order=profile.transport.word_order)
        self._transport = profile.transport
        self._kept = dict(kept)
        self.decimals = profile.decimals

    def read(self, quantity: Quantity) -> float:
        """Return one quantity in its unit."""
        return self.read_together((quantity,))[quantity.name]

    def read_together(self, quantities: Iterable[Quantity]) -> dict[str, float]:
        """Return several quantities by name, with as few requests as the controller allows."""
        wanted = list(quantities)
        words = self.read_words(wanted)
        return {quantity.name: self.value_of(quantity, words) for quantity in wanted}

    def read_words(self, quantities: Iterable[Quantity]) -> dict[int, int]:
        """Return the registers of several quantities, and of the runs that contain them, by address."""
        words: dict[int, int] = {}
        for first, count in self._requests(quantities):
            words |= zip(range(first, first + count), self._link.read(first, count), strict=True)
        return words

    def value_of(self, quantity: Quantity, words: Mapping[int, int]) -> float:
        """Return a quantity in its unit from registers that have been read."""
        if quantity.name in self._kept:  # rounded as a register would store it
            return self.kept(quantity, self._kept[quantity.name])
        return self._value(quantity, [words[quantity.address + place] for place in range(WORDS[quantity.kind])])

    def write(self, quantity: Quantity, value: float, *, once: bool = False) -> None:
        """Write a value without reading it back."""
        if quantity.name in self._kept:
            self._kept[quantity.name] = value
            return
        words = self._words(quantity, value)
        several = WRITE_ONE not in self._transport.functions
        self._link.write(quantity.address, words, several=several, once=once)

    def put(self, quantity: Quantity, value: float) -> None:
        """Write a value and read it back; a register that wears is not rewritten with an equal value."""
        kept = self.kept(quantity, value)
        if isinstance(quantity, ProfiledQuantity):
            if quantity.wears and self.read(quantity) == kept:
                return
            if not quantity.readable:
                self.write(quantity, value)
                return
        self.write(quantity, value)
        self.confirm(quantity, kept)

    def _requests(self, quantities: Iterable[Quantity]) -> list[tuple[int, int]]:
        """Return first register and number of registers of each request: declared runs, and joined neighbours."""
        runs: set[tuple[int, int]] = set()
        joined: list[tuple[int, int]] = []
        spans = {(quantity.address, WORDS[quantity.kind]) for quantity in quantities if quantity.name not in self._kept}
        for first, count in sorted(spans):
            if declared := self._declared(first, count):
                runs.add(declared)
                continue
            before, length = joined[-1] if joined else (NOWHERE, 0)
            reach = max(length, first + count - before)
            if joined and first <= before + length and reach <= self._transport.most_registers:
                joined[-1] = before, reach
            else:
                joined.append((first, count))
        return sorted([*runs, *joined])

    def _declared(self, first: int, count: int) -> tuple[int, int] | None:
        """Return the run that contains some registers, or None."""
        for run in self._transport.runs:
            if run.first <= first and first + count <= run.first + run.count:
                return run.first, run.count
        return None

    def _words(self, quantity: Quantity, value: float) -> list[int]:
        if quantity.kind != "code" or not math.isfinite(value):
            return super()._words(quantity, value)
        word = round(value * 10.0 ** self._digits(quantity))
        if not 0 <= word <= 0xFFFF:
            raise UsageError(
                f"{self._link.who}: {quantity.name} cannot be set to {value:g} {quantity.unit}".rstrip()
                + ": its register (u16) does not reach so far; give one that it can hold"
            )
        return [word]

    def _value(self, quantity: Quantity, words: list[int]) -> float:
        if isinstance(quantity, ProfiledQuantity) and (fault := self._no_temperature(quantity, words)):
            raise InstrumentError(
                f"{self._link.who}: no valid temperature, {quantity.name} (register {quantity.address}) {fault};"
                f" {ADVICE}"
            )
        return super()._value(quantity, words)

    def _no_temperature(self, quantity: ProfiledQuantity, words: list[int]) -> str:
        """Return what is wrong with a number or temperature; empty if it is valid."""
        value = self._decoded(quantity, words)
        if math.isnan(value) and quantity.unit == "°C":
            return "reads no number (NaN)"
        held = value * 10.0 ** self._digits(quantity) if quantity.kind != "f32" else value
        for code, text in quantity.invalid.items():
            if math.isclose(held, code, rel_tol=1e-6):
                return f"reads {code:g} ({text})"
        if quantity.valid is not None and not quantity.valid[0] <= value <= quantity.valid[1]:
            return f"reads {value:g} {quantity.unit}, expected {quantity.valid[0]:g} to {quantity.valid[1]:g}"
        return ""

    def _decoded(self, quantity: Quantity, words: list[int]) -> float:
        if quantity.kind != "code":
            return super()._decoded(quantity, words)
        mask = quantity.mask if isinstance(quantity, ProfiledQuantity) else 0xFFFF
        return (words[0] & mask) / 10.0 ** self._digits(quantity)


NAME = "conditioning"


class Conditioning(Protocol):
    """One way to switch conditioning."""

    def turn(self, *, on: bool) -> None:
        """Switch and confirm; no effect if the state is already correct."""

    def is_on(self) -> bool:
        """Return whether the chamber conditions according to its registers."""


def conditioning_of(profile: Profile, table: ProfiledTable) -> Conditioning:
    """Return the way of switching that a profile declares."""
    switch = profile.switch
    if isinstance(switch, RegisterSwitch):
        return ByRegister(switch, profile, table)
    if isinstance(switch, BitSwitch):
        return ByBit(switch, table)
    if isinstance(switch, KeySwitch):
        return ByKey(switch, table)
    return AlwaysOn()


class AlwaysOn:
    """No switch is wired: the chamber conditions while it has power."""

    def turn(self, *, on: bool) -> None:
        """Do nothing."""

    def is_on(self) -> bool:
        """Return True."""
        return True


class ByRegister:
    """A code for on, another one for off, and optional numbers to write after switching off."""

    def __init__(self, switch: RegisterSwitch, profile: Profile, table: ProfiledTable) -> None:
        self._table = table
        self._switch = switch
        self._written = code(NAME, switch.address, writable=True)
        self._shown = code(NAME, _or(switch.shown, switch.address), mask=switch.mask)
        self._after_off = [
            (quantity_of(setting, "output", "", profile=profile, writable=True), setting.value)
            for setting in switch.after_off
        ]

    def turn(self, *, on: bool) -> None:
        """Write the code and wait until the register shows it."""
        wanted = self._switch.on if on else self._switch.off
        self._table.write(self._written, wanted)
        self._table.confirm(self._shown, wanted & self._switch.mask)
        if not on:
            self._finish_off()

    def is_on(self) -> bool:
        """Return whether the register shows the code for on."""
        return self._table.read_code(self._shown) == self._switch.on & self._switch.mask

    def _finish_off(self) -> None:
        for quantity, value in self._after_off:
            try:
                self._table.put(quantity, value)
            except BenchError as err:
                raise type(err)(f"{err}; the code for off is written, yet the output may stay as it was") from err


class ByBit:
    """One bit of a register; the other bits are written as they were read."""

    def __init__(self, switch: BitSwitch, table: ProfiledTable) -> None:
        self._table = table
        self._bit = 1 << switch.bit
        self._set_is_on = switch.on == 1
        shown = _or(switch.shown, switch.address)
        self._written = code(NAME, switch.address, writable=True)
        self._all_bits = code(NAME, shown)
        self._shown = code(f"{NAME}, bit {switch.bit}", shown, mask=self._bit)

    def turn(self, *, on: bool) -> None:
        """Read all bits, write them with this one changed, and wait until the register shows it."""
        wanted = self._bit if on == self._set_is_on else 0
        present = self._table.read_code(self._all_bits)
        self._table.write(self._written, present & ~self._bit | wanted)
        self._table.confirm(self._shown, wanted)

    def is_on(self) -> bool:
        """Return whether the bit is in its state for on."""
        return bool(self._table.read_code(self._shown)) == self._set_is_on


class ByKey:
    """A key that changes the state with each press; pressed only once: a second press would undo the first."""

    def __init__(self, switch: KeySwitch, table: ProfiledTable) -> None:
        self._table = table
        self._switch = switch
        self._key = code(f"key of {NAME}", switch.address, writable=True)
        self._shown = code(NAME, switch.shown, mask=switch.mask)

    def turn(self, *, on: bool) -> None:
        """Press the key if the state differs from the wanted one, and wait until it is reached."""
        wanted = (self._switch.on if on else self._switch.off) & self._switch.mask
        if self._table.read_code(self._shown) != wanted:
            self._table.write(self._key, self._switch.press, once=True)
            self._table.confirm(self._shown, wanted)

    def is_on(self) -> bool:
        """Return whether the register shows the code for on."""
        return self._table.read_code(self._shown) == self._switch.on & self._switch.mask


def code(name: str, address: int, *, mask: int = 0xFFFF, writable: bool = False) -> ProfiledQuantity:
    """Return a quantity for a register that holds a code."""
    return ProfiledQuantity(name=name, address=address, kind="code", decimals=0, mask=mask, writable=writable)


def _or(address: int | None, other: int) -> int:
    return other if address is None else address
