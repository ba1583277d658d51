"""A chamber profile: what a controller behind Modbus keeps in which register, declared in a TOML file.

A lab adds its own controller with such a file and without Python; `profiles/` holds the ones that come with the
drivers, to copy from. Registers are numbered as on the wire, from 0. What the tables mean:

| table                       | what it declares                                                                      |
|-----------------------------|---------------------------------------------------------------------------------------|
| `name`, `source`            | what errors call the controller; where its numbers come from                          |
| `[transport]`               | how it wants to be talked to                                                          |
| `decimals`                  | the implied decimal point of numbers that do not state their own, or its register     |
| `[[checks]]`                | registers that must hold certain codes, looked at when the chamber is opened          |
| `[busy]`                    | a register that says that the controller is busy; it is waited for                    |
| `[air]`                     | the air's temperature, and the codes that stand there instead of one                  |
| `[setpoint]`                | the set point, what else takes it, and what makes the controller take it over         |
| `[low_limit]` `[high_limit]`| the set point's limits; a controller without such registers has `kept_limits_c`       |
| `[power]`                   | one number with its sign, or `[heating]` and `[cooling]`                              |
| `[[input_errors]]`          | conditions in which there is no temperature                                           |
| `[[alarms]]`                | conditions that stop a run; a latched one says what clears it                         |
| `[[modes]]`                 | conditions in which the controller would not keep our set point                       |
| `[switch]`                  | how conditioning is switched on and off                                               |
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from benchctl_instruments.protocols.modbus import MOST_READ
from benchctl_instruments.protocols.words import WordOrder

NumberKind = Literal["u16", "signed", "f32"]
WORDS: dict[NumberKind, int] = {"u16": 1, "signed": 1, "f32": 2}
HIGHEST_WORD = 0xFFFF
MOST_DECIMALS = 3


def _one_line(text: str) -> str:
    if not text.strip() or not text.isprintable():
        raise ValueError(f"expected some words in one line, got {text!r}")
    return text


def _whole_number_keys(table: dict[str, str]) -> dict[str, str]:
    for key in table:
        _code(key)
    return table


def _number_keys(table: dict[str, str]) -> dict[str, str]:
    for key in table:
        number_of(key)
    return table


def _bit_keys(table: dict[str, str]) -> dict[str, str]:
    for key in table:
        if _code(key) > 15:
            raise ValueError(f"expected bits 0 to 15 in front of the words, got {key!r}")
    return table


def _code(key: str) -> int:
    try:
        code = int(key, 0)
    except ValueError:
        code = -1
    if not 0 <= code <= HIGHEST_WORD:
        raise ValueError(f"expected whole numbers 0 to {HIGHEST_WORD} in front of the words, got {key!r}")
    return code


def number_of(key: str) -> float:
    """A number that TOML brings as a key: 32767, -1, 0x7FFF, 9999.9; `ValueError` where it is none."""
    try:
        number = float(key) if "0x" not in key.lower() else float(int(key, 0))
    except (ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"expected numbers in front of the words, got {key!r}")
    return number


Text = Annotated[str, AfterValidator(_one_line)]
Address = Annotated[int, Field(strict=True, ge=0, le=HIGHEST_WORD)]
Word = Annotated[int, Field(strict=True, ge=0, le=HIGHEST_WORD)]
Decimals = Annotated[int, Field(strict=True, ge=0, le=MOST_DECIMALS)]
WordTexts = Annotated[dict[str, Text], AfterValidator(_whole_number_keys)]
NumberTexts = Annotated[dict[str, Text], AfterValidator(_number_keys)]
BitTexts = Annotated[dict[str, Text], AfterValidator(_bit_keys)]


class ProfileTable(BaseModel):
    """What all tables of a profile have in common: no unknown fields, no infinite numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Run(ProfileTable):
    """Registers that are always read together, with exactly this request."""

    first: Address
    count: Annotated[int, Field(strict=True, ge=1, le=MOST_READ)]


class Transport(ProfileTable):
    """How the controller wants to be talked to.

    `functions` are those that it knows of 3 (read), 6 (write one) and 16 (write several); a single word goes with
    function 6 where that is one of them. `baud` is that of a serial address that names none. `pause_s` is quiet time
    between two exchanges. Neighbours are read together, at most `most_registers` of them, unless they belong to one of
    the `runs`; registers in a `restricted` range (first, last) are never touched.
    """

    functions: tuple[Literal[3, 6, 16], ...] = (3, 6, 16)
    unit_id: int = Field(default=1, strict=True, ge=1, le=254)
    baud: int | None = Field(default=None, strict=True, gt=0)
    pause_s: float = Field(default=0.0, ge=0, le=60)
    timeout_s: float = Field(default=1.0, gt=0, le=60)
    word_order: WordOrder = "high_first"
    most_registers: int = Field(default=MOST_READ, strict=True, ge=1, le=MOST_READ)
    runs: tuple[Run, ...] = ()
    restricted: tuple[tuple[Address, Address], ...] = ()


class Number(ProfileTable):
    """A number in a register.

    `kind` is "signed" (two's complement) or "u16", both with an implied decimal point, or "f32". `decimals` are the
    digits behind that point; without them as many as the profile says for all.
    """

    address: Address
    kind: NumberKind
    decimals: Decimals | None = None


class AirTemperature(Number):
    """The air's temperature.

    `invalid` are numbers that stand there where there is no temperature, as the register holds them, before any decimal
    point, with what they mean. What lies outside `valid_c` is no temperature either.
    """

    invalid: NumberTexts = Field(default_factory=dict)
    valid_c: tuple[float, float] | None = None


class Command(ProfileTable):
    """A word to write, and where."""

    address: Address
    value: Word


class Setting(Number):
    """A number to write, confirmed by reading it back."""

    value: float


class Setpoint(Number):
    """The set point.

    `also` are further registers that take the same number. `readable` is false where the register can only be written.
    `wears` says that it lies in a memory that endures a limited number of writes: then only a change is written. `run`
    is a command without which the controller does not obey a new set point, and `taken` is where it shows the one that
    it obeys: the one is given and the other looked at while the chamber conditions, and when that starts.
    """

    also: tuple[Address, ...] = ()
    readable: bool = True
    wears: bool = False
    taken: Number | None = None
    run: Command | None = None


class Condition(ProfileTable):
    """A register that says how things are: fine, or not.

    Either a code: `fine` are the codes in which all is well, `words` what others mean, `otherwise` what all the rest
    mean. Or a status word: `bits` says what each bit means that matters. `clear` is what has to be written, by hand, to
    clear it where it is latched.
    """

    name: Text
    address: Address
    fine: tuple[Word, ...] = Field(default=(0,), min_length=1)
    words: WordTexts = Field(default_factory=dict)
    otherwise: Text | None = None
    bits: BitTexts = Field(default_factory=dict)
    clear: Command | None = None

    def stand(self, word: int) -> list[str]:
        """What a word of the register says that is not fine, in words."""
        if self.bits:
            return [f"{self.name}: {text}" for bit, text in self.bits.items() if word >> int(bit, 0) & 1]
        if word in self.fine:
            return []
        known = {int(code, 0): text for code, text in self.words.items()}
        return [f"{self.name} {known.get(word, self.otherwise or f'shows code {word}')}"]


class Check(ProfileTable):
    """A register that must hold one of the `expected` codes; `advice` is what to do where it does not."""

    name: Text
    address: Address
    expected: tuple[Word, ...] = Field(min_length=1)
    advice: Text


class Busy(ProfileTable):
    """A register that holds one of the `free` codes while the controller can be used.

    At most `wait_s` are waited; `advice` is what to do where that was not enough.
    """

    address: Address
    free: tuple[Word, ...] = Field(default=(0,), min_length=1)
    wait_s: float = Field(default=10.0, ge=0, le=600)
    advice: Text = "look what it shows on its panel"


class NothingWired(ProfileTable):
    """The chamber conditions while it has power; starting and stopping leave it so."""

    by: Literal["nothing"]


class RegisterSwitch(ProfileTable):
    """A register, often one of modes, that takes one code for on and another one for off.

    `shown` is where the state is read, by default where it is written; of what is read only the bits of `mask` count.
    `after_off` are numbers to write once it is off.
    """

    by: Literal["register"]
    address: Address
    on: Word
    off: Word
    shown: Address | None = None
    mask: Word = HIGHEST_WORD
    after_off: tuple[Setting, ...] = ()

    @model_validator(mode="after")
    def _two_states(self) -> RegisterSwitch:
        if self.on & self.mask == self.off & self.mask:
            raise ValueError(f"on ({self.on}) and off ({self.off}) cannot be told apart")
        return self


class BitSwitch(ProfileTable):
    """A bit of a register whose other bits stay as they are; `on` is its state in which the chamber conditions.

    `shown` is where the present bits are read, by default where they are written.
    """

    by: Literal["bit"]
    address: Address
    bit: Annotated[int, Field(strict=True, ge=0, le=15)]
    on: Literal[0, 1] = 1
    shown: Address | None = None


class KeySwitch(ProfileTable):
    """A key that changes the state with each press, written once and never again; `shown` is where the state is."""

    by: Literal["key"]
    address: Address
    press: Word
    shown: Address
    on: Word
    off: Word
    mask: Word = HIGHEST_WORD

    @model_validator(mode="after")
    def _two_states(self) -> KeySwitch:
        if self.on & self.mask == self.off & self.mask:
            raise ValueError(f"on ({self.on}) and off ({self.off}) cannot be told apart")
        return self


Switch = Annotated[NothingWired | RegisterSwitch | BitSwitch | KeySwitch, Field(discriminator="by")]


class Profile(ProfileTable):
    """A controller; see the module for its tables. Made by `profile_file`, which also looks for contradictions."""

    name: Text
    source: Text
    manufacturer: str = ""
    model: str = ""
    transport: Transport = Transport()
    decimals: Decimals = 0
    decimals_register: Address | None = None
    checks: tuple[Check, ...] = ()
    busy: Busy | None = None
    air: AirTemperature
    setpoint: Setpoint
    low_limit: Number | None = None
    high_limit: Number | None = None
    kept_limits_c: tuple[float, float] | None = None
    power: Number | None = None
    heating: Number | None = None
    cooling: Number | None = None
    input_errors: tuple[Condition, ...] = ()
    alarms: tuple[Condition, ...] = ()
    modes: tuple[Condition, ...] = ()
    switch: Switch
