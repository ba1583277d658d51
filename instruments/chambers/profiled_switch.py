"""How conditioning is switched on and off, as a profile declares it; each way does it, confirms it and can look."""

from __future__ import annotations

from typing import Protocol

from benchctl_instruments.chambers.profile import BitSwitch, KeySwitch, Profile, RegisterSwitch
from benchctl_instruments.chambers.profiled_table import ProfiledQuantity, ProfiledTable, quantity_of
from benchctl_instruments.errors import BenchError

NAME = "conditioning"


class Conditioning(Protocol):
    """One way to switch."""

    def turn(self, *, on: bool) -> None:
        """Switch, confirmed; harmless where it is so already."""

    def is_on(self) -> bool:
        """Whether the chamber conditions, as its registers say."""


def conditioning_of(profile: Profile, table: ProfiledTable) -> Conditioning:
    """The way that a profile declares."""
    switch = profile.switch
    if isinstance(switch, RegisterSwitch):
        return ByRegister(switch, profile, table)
    if isinstance(switch, BitSwitch):
        return ByBit(switch, table)
    if isinstance(switch, KeySwitch):
        return ByKey(switch, table)
    return AlwaysOn()


class AlwaysOn:
    """Nothing is wired: the chamber conditions while it has power."""

    def turn(self, *, on: bool) -> None:
        """Nothing to switch."""

    def is_on(self) -> bool:
        """Always."""
        return True


class ByRegister:
    """A code for on, another one for off, and perhaps numbers to write once it is off."""

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
        """Write the code, wait until it shows."""
        wanted = self._switch.on if on else self._switch.off
        self._table.write(self._written, wanted)
        self._table.confirm(self._shown, wanted & self._switch.mask)
        if not on:
            self._finish_off()

    def is_on(self) -> bool:
        """Whether the code for on shows."""
        return self._table.read_code(self._shown) == self._switch.on & self._switch.mask

    def _finish_off(self) -> None:
        for quantity, value in self._after_off:
            try:
                self._table.put(quantity, value)
            except BenchError as err:
                raise type(err)(f"{err}; the code for off is written, yet the output may stay as it was") from err


class ByBit:
    """A bit of a register; the other bits are written as they were read."""

    def __init__(self, switch: BitSwitch, table: ProfiledTable) -> None:
        self._table = table
        self._bit = 1 << switch.bit
        self._set_is_on = switch.on == 1
        shown = _or(switch.shown, switch.address)
        self._written = code(NAME, switch.address, writable=True)
        self._all_bits = code(NAME, shown)
        self._shown = code(f"{NAME}, bit {switch.bit}", shown, mask=self._bit)

    def turn(self, *, on: bool) -> None:
        """Read all bits, write them with this one changed, wait until it shows."""
        wanted = self._bit if on == self._set_is_on else 0
        present = self._table.read_code(self._all_bits)
        self._table.write(self._written, present & ~self._bit | wanted)
        self._table.confirm(self._shown, wanted)

    def is_on(self) -> bool:
        """Whether the bit shows its state for on."""
        return bool(self._table.read_code(self._shown)) == self._set_is_on


class ByKey:
    """A key that changes the state with each press: pressed once where it must be, for a second press would undo it."""

    def __init__(self, switch: KeySwitch, table: ProfiledTable) -> None:
        self._table = table
        self._switch = switch
        self._key = code(f"key of {NAME}", switch.address, writable=True)
        self._shown = code(NAME, switch.shown, mask=switch.mask)

    def turn(self, *, on: bool) -> None:
        """Press where the state is not yet as wanted, wait until it is."""
        wanted = (self._switch.on if on else self._switch.off) & self._switch.mask
        if self._table.read_code(self._shown) != wanted:
            self._table.write(self._key, self._switch.press, once=True)
            self._table.confirm(self._shown, wanted)

    def is_on(self) -> bool:
        """Whether the code for on shows."""
        return self._table.read_code(self._shown) == self._switch.on & self._switch.mask


def code(name: str, address: int, *, mask: int = 0xFFFF, writable: bool = False) -> ProfiledQuantity:
    """A register that holds a code."""
    return ProfiledQuantity(name=name, address=address, kind="code", decimals=0, mask=mask, writable=writable)


def _or(address: int | None, other: int) -> int:
    return other if address is None else address
