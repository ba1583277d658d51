"""Chamber profiles: TOML files that declare the registers of a Modbus controller.

A lab adds its own controller with such a file, without Python; `profiles/` holds the profiles that are shipped with the
drivers, as examples. Registers are numbered from 0, as on the wire. Meaning of the tables:

| table                       | what it declares                                                                      |
|-----------------------------|---------------------------------------------------------------------------------------|
| `name`, `source`            | name of the controller in error messages; source of the numbers                       |
| `[transport]`               | how the controller communicates                                                       |
| `decimals`                  | the implied decimal point of numbers that do not state their own, or its register     |
| `[[checks]]`                | registers that must hold certain codes, checked when the chamber is opened            |
| `[busy]`                    | a register that shows that the controller is busy; the driver waits for it            |
| `[air]`                     | the air temperature, and the codes that replace it when it is invalid                 |
| `[setpoint]`                | the set point, further registers for it, and how the controller accepts it            |
| `[low_limit]` `[high_limit]`| the set point's limits; a controller without such registers has `kept_limits_c`       |
| `[power]`                   | one number with its sign, or `[heating]` and `[cooling]`                              |
| `[[input_errors]]`          | conditions in which there is no valid temperature                                     |
| `[[alarms]]`                | conditions that stop a run; a latched one states how to clear it                      |
| `[[modes]]`                 | conditions in which the controller would not keep the set point                       |
| `[switch]`                  | how conditioning is switched on and off                                               |

A profile is parsed from its file into these tables, or rejected with one line that names the file and the invalid
field. The fields are also checked against each other.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from benchctl_instruments.errors import UsageError, in_line, reason
from benchctl_instruments.field_faults import field_fault
from benchctl_instruments.protocols.modbus import MOST_READ, WordOrder

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
        raise ValueError(f"expected integers 0 to {HIGHEST_WORD} in front of the words, got {key!r}")
    return code


def number_of(key: str) -> float:
    """Return a number from a TOML key: 32767, -1, 0x7FFF, 9999.9; raises `ValueError` if the key is not a number."""
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
    """Base class of all tables of a profile: no unknown fields, no infinite numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Run(ProfileTable):
    """Registers that are always read together, with exactly this request."""

    first: Address
    count: Annotated[int, Field(strict=True, ge=1, le=MOST_READ)]


class Transport(ProfileTable):
    """Communication settings of the controller.

    `functions` are the supported ones of 3 (read), 6 (write one) and 16 (write several); a single word is written with
    function 6 if that is supported. `baud` is the speed of a serial address that states none. `pause_s` is quiet time
    between two exchanges. Neighbouring registers are read together, at most `most_registers` of them, unless they
    belong to one of the `runs`; registers in a `restricted` range (first, last) are never accessed.
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

    `kind` is "signed" (two's complement) or "u16", both with an implied decimal point, or "f32". `decimals` is the
    number of digits after that point; by default the profile's `decimals`.
    """

    address: Address
    kind: NumberKind
    decimals: Decimals | None = None


class AirTemperature(Number):
    """The air temperature.

    `invalid` maps register values that mark an invalid temperature, before the decimal point is applied, to their
    meaning. Values outside `valid_c` are invalid too.
    """

    invalid: NumberTexts = Field(default_factory=dict)
    valid_c: tuple[float, float] | None = None


class Command(ProfileTable):
    """A word to write, and its register."""

    address: Address
    value: Word


class Setting(Number):
    """A number to write, confirmed by reading it back."""

    value: float


class Setpoint(Number):
    """The set point.

    `also` are further registers that take the same number. `readable` is false if the register can only be written.
    `wears` states that the register is in a memory with a limited number of writes: then only a changed value is
    written. `run` is a command without which the controller does not follow a new set point, and `taken` is the
    register that shows the set point that it follows: `run` is sent and `taken` checked while the chamber conditions,
    and when conditioning starts.
    """

    also: tuple[Address, ...] = ()
    readable: bool = True
    wears: bool = False
    taken: Number | None = None
    run: Command | None = None


class Condition(ProfileTable):
    """A register that shows a status: normal, or not.

    Either a code: `fine` are the normal codes, `words` the meanings of others, `otherwise` the meaning of all remaining
    ones. Or a status word: `bits` maps each relevant bit to its meaning. `clear` is the command that an operator must
    send to clear a latched condition.
    """

    name: Text
    address: Address
    fine: tuple[Word, ...] = Field(default=(0,), min_length=1)
    words: WordTexts = Field(default_factory=dict)
    otherwise: Text | None = None
    bits: BitTexts = Field(default_factory=dict)
    clear: Command | None = None

    def stand(self, word: int) -> list[str]:
        """Return the texts of everything abnormal in a word of the register."""
        if self.bits:
            return [f"{self.name}: {text}" for bit, text in self.bits.items() if word >> int(bit, 0) & 1]
        if word in self.fine:
            return []
        known = {int(code, 0): text for code, text in self.words.items()}
        return [f"{self.name} {known.get(word, self.otherwise or f'shows code {word}')}"]


class Check(ProfileTable):
    """A register that must hold one of the `expected` codes; `advice` is what to do if it does not."""

    name: Text
    address: Address
    expected: tuple[Word, ...] = Field(min_length=1)
    advice: Text


class Busy(ProfileTable):
    """A register that holds one of the `free` codes while the controller can be used.

    The driver waits at most `wait_s`; `advice` is what to do if that was not long enough.
    """

    address: Address
    free: tuple[Word, ...] = Field(default=(0,), min_length=1)
    wait_s: float = Field(default=10.0, ge=0, le=600)
    advice: Text = "look what it shows on its panel"


class NothingWired(ProfileTable):
    """The chamber conditions while it has power; starting and stopping do not change that."""

    by: Literal["nothing"]


class RegisterSwitch(ProfileTable):
    """A register, often a mode register, that takes one code for on and another one for off.

    `shown` is the register from which the state is read, by default the written one; only the bits of `mask` are
    compared. `after_off` are numbers to write after switching off.
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
            raise ValueError(f"on ({self.on}) and off ({self.off}) are not distinguishable")
        return self


class BitSwitch(ProfileTable):
    """One bit of a register whose other bits do not change; `on` is its state while the chamber conditions.

    `shown` is the register from which the present bits are read, by default the written one.
    """

    by: Literal["bit"]
    address: Address
    bit: Annotated[int, Field(strict=True, ge=0, le=15)]
    on: Literal[0, 1] = 1
    shown: Address | None = None


class KeySwitch(ProfileTable):
    """A key that changes the state with each press, written once and never repeated; `shown` holds the state."""

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
            raise ValueError(f"on ({self.on}) and off ({self.off}) are not distinguishable")
        return self


Switch = Annotated[NothingWired | RegisterSwitch | BitSwitch | KeySwitch, Field(discriminator="by")]


class Profile(ProfileTable):
    """A controller; the module describes its tables. Created by `profile_of`, which also checks for contradictions."""

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


READ, WRITE_ONE, WRITE_SEVERAL = 3, 6, 16
RANGES: dict[NumberKind, tuple[float, float]] = {"u16": (0, 0xFFFF), "signed": (-0x8000, 0x7FFF), "f32": (-3e38, 3e38)}


def contradiction(profile: Profile) -> str:
    """Return the first contradiction, in words that begin with the field; empty if there is none."""
    return next(_contradictions(profile), "")


def _contradictions(profile: Profile) -> Iterator[str]:
    yield from _limits(profile)
    if profile.power is not None and (profile.heating is not None or profile.cooling is not None):
        yield "power: it is one number with its sign, or heating and cooling, not both"
    if not profile.setpoint.readable and profile.setpoint.wears:
        yield "setpoint.wears: only a change is written, so the register must be readable"
    if not profile.setpoint.readable and profile.setpoint.taken is None:
        yield "setpoint.readable: what cannot be read back needs setpoint.taken, where the controller shows it"
    yield from _functions(profile)
    yield from _addresses(profile)
    yield from _overlaps(profile)
    for name in ("input_errors", "alarms", "modes"):
        for place, condition in enumerate(getattr(profile, name)):
            if condition.bits and condition.model_fields_set & {"fine", "words", "otherwise"}:
                yield f"{name}.{place}.bits: a status word has bits, a code has fine, words and otherwise, not both"


def _limits(profile: Profile) -> Iterator[str]:
    registers = (profile.low_limit, profile.high_limit)
    if (registers[0] is None) != (registers[1] is None):
        yield "low_limit: a controller has both limits or none"
    if (registers[0] is None) == (profile.kept_limits_c is None):
        yield "kept_limits_c: needed where there are no low_limit and high_limit, and only there"
    for limit_c in profile.kept_limits_c or ():
        if not _fits(profile.setpoint, limit_c, profile.decimals):
            yield f"kept_limits_c: {limit_c:g} does not fit into the set point's register ({profile.setpoint.kind})"
    for field, pair in (("kept_limits_c", profile.kept_limits_c), ("air.valid_c", profile.air.valid_c)):
        if pair is not None and pair[0] >= pair[1]:
            yield f"{field}: the first ({pair[0]:g}) must be below the second ({pair[1]:g})"


def _functions(profile: Profile) -> Iterator[str]:
    functions = profile.transport.functions
    if READ not in functions or not {WRITE_ONE, WRITE_SEVERAL} & set(functions):
        yield "transport.functions: needs 3, to read, and 6 or 16, to write"
    for field, number in _written(profile):
        if number.kind == "f32" and WRITE_SEVERAL not in functions:
            yield f"{field}: an f32 is written with function 16, which is not in transport.functions"
        if isinstance(number, Setting) and not _fits(number, number.value, profile.decimals):
            yield f"{field}: {number.value:g} does not fit into a register of kind {number.kind}"


def _fits(number: Number, value: float, decimals: int) -> bool:
    low, high = RANGES[number.kind]
    shift = 0 if number.kind == "f32" else decimals if number.decimals is None else number.decimals
    return low <= value * 10.0**shift <= high


def _addresses(profile: Profile) -> Iterator[str]:
    transport = profile.transport
    for place, (first, last) in enumerate(transport.restricted):
        if first > last:
            yield f"transport.restricted.{place}: the first register ({first}) lies above the last one ({last})"
    for place, run in enumerate(transport.runs):
        if run.count > transport.most_registers:
            yield (
                f"transport.runs.{place}: {run.count} registers, and transport.most_registers is"
                f" {transport.most_registers}"
            )
        yield from _outside(profile, f"transport.runs.{place}", run.first, run.count)
    for field, number in numbers(profile):
        if WORDS[number.kind] > transport.most_registers:
            yield f"{field}: an f32 takes two registers, and transport.most_registers is {transport.most_registers}"
        yield from _outside(profile, field, number.address, WORDS[number.kind])
    for field, address in words(profile):
        yield from _outside(profile, field, address, 1)


def _outside(profile: Profile, field: str, first: int, count: int) -> Iterator[str]:
    if first + count > 0x10000:
        yield f"{field}: registers {first} to {first + count - 1}, and there are none above 65535"
    for start, end in profile.transport.restricted:
        if first <= end and start <= first + count - 1:
            yield f"{field}: register {max(first, start)} lies in the restricted range {start} to {end}"


def _overlaps(profile: Profile) -> Iterator[str]:
    """Yield registers that are declared with two different meanings; a repeated equal declaration is accepted."""
    spans: list[tuple[str, int, str, int]] = [
        (field, number.address, number.kind, WORDS[number.kind]) for field, number in numbers(profile)
    ]
    spans += [(field, address, "code", 1) for field, address in words(profile)]
    first_at: dict[int, tuple[str, int, str]] = {}
    for field, first, kind, count in spans:
        for address in range(first, first + count):
            other, other_first, other_kind = first_at.setdefault(address, (field, first, kind))
            if (other_first, other_kind) != (first, kind):
                yield f"{field}: register {address} ({kind}) is also {other}'s ({other_kind} from {other_first} on)"


def numbers(profile: Profile) -> Iterator[tuple[str, Number]]:
    """Yield every number of a profile with the name of its field."""
    names = ("air", "setpoint", "low_limit", "high_limit", "power", "heating", "cooling")
    for name in names:
        number = getattr(profile, name)
        if number is not None:
            yield name, number
    for place, address in enumerate(profile.setpoint.also):
        yield f"setpoint.also.{place}", profile.setpoint.model_copy(update={"address": address})
    if profile.setpoint.taken is not None:
        yield "setpoint.taken", profile.setpoint.taken
    if isinstance(profile.switch, RegisterSwitch):
        for place, setting in enumerate(profile.switch.after_off):
            yield f"switch.after_off.{place}", setting


def words(profile: Profile) -> Iterator[tuple[str, int]]:
    """Yield every single register of a profile that holds no number, with the name of its field."""
    if profile.decimals_register is not None:
        yield "decimals_register", profile.decimals_register
    if profile.busy is not None:
        yield "busy.address", profile.busy.address
    if profile.setpoint.run is not None:
        yield "setpoint.run.address", profile.setpoint.run.address
    for place, check in enumerate(profile.checks):
        yield f"checks.{place}.address", check.address
    for name in ("input_errors", "alarms", "modes"):
        for place, condition in enumerate(getattr(profile, name)):
            yield f"{name}.{place}.address", condition.address
    if isinstance(profile.switch, RegisterSwitch | BitSwitch | KeySwitch):
        yield "switch.address", profile.switch.address
        if profile.switch.shown is not None:
            yield "switch.shown", profile.switch.shown


def _written(profile: Profile) -> Iterator[tuple[str, Number]]:
    for field, number in numbers(profile):
        if field.startswith(("setpoint", "low_limit", "high_limit", "switch")) and field != "setpoint.taken":
            yield field, number


LONGEST_SHOWN = 60
MOST_BYTES = 1 << 17
"""Largest size of a profile; the shipped ones have about 2000 bytes."""
MOST_DOTS = 200
"""Most dots in a line. The time of Python's TOML reader for a dotted key grows with the square of its parts."""


def profile_name(path: str | Path) -> str:
    """Return the name of a profile in error messages."""
    return _printable(f"chamber profile {path}")


def profile_text(path: Path) -> str:
    """Return the text of a profile's file.

    Raises
    ------
    UsageError
        If it cannot be read, is not a regular file (a pipe might never end), is not UTF-8, or is too large.
    """
    name = profile_name(path)
    try:
        if path.exists() and not path.is_file():
            raise UsageError(f"{name}: cannot be read: it is no file; name one")
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        text = content.decode("utf-8")
    except OSError as err:
        raise UsageError(f"{name}: cannot be read: {reason(err)}") from err
    except ValueError as err:  # not UTF-8, or an invalid file name
        raise UsageError(f"{name}: cannot be read as UTF-8 text: {_printable(str(err))}") from err
    if len(content) > MOST_BYTES:
        raise UsageError(f"{name}: is larger than {MOST_BYTES >> 10} KiB, which no profile needs")
    return text


@cache
def shipped_profile(name: str) -> Profile:
    """Return one of the profiles shipped with the drivers."""
    text = files("benchctl_instruments.chambers.profiles").joinpath(f"{name}.toml").read_text(encoding="utf-8")
    return parse_profile(text, f"chamber profile {name}.toml")


def parse_profile(text: str, name: str) -> Profile:
    """Return the profile that a TOML text declares; `name` is its name in error messages.

    Raises
    ------
    UsageError
        If it is too large, is not TOML, or is invalid; the message names the first invalid field.
    """
    if len(text) > MOST_BYTES:
        raise UsageError(f"{name}: {len(text)} characters, expected at most {MOST_BYTES}")
    for number, line in enumerate(text.split("\n"), 1):
        if (dots := line.count(".")) > MOST_DOTS:
            raise UsageError(f"{name}, line {number}: {dots} dots, expected at most {MOST_DOTS} in a line")
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as err:  # also numbers of thousands of digits, and equally deep nesting
        raise UsageError(f"{name}: not TOML: {_printable(in_line(str(err)))}") from err
    return profile_of(document, name)


def changed(profile: Profile, changes: Mapping[str, Any], name: str) -> Profile:
    """Return a profile with some fields replaced, table by table; lists are replaced completely."""
    if not isinstance(changes, Mapping):
        raise UsageError(f"{name}: expected a table with fields of the profile, got {_shown(changes)}")
    document = profile.model_dump(exclude_unset=True)
    if isinstance(changes.get("switch"), Mapping) and "by" in changes["switch"]:
        document.pop("switch", None)  # another kind of switch has other fields
    return profile_of(_merged(document, changes), name)


def profile_of(document: Mapping[str, Any], name: str) -> Profile:
    """Return the profile that a document declares; `name` is its name in error messages."""
    try:
        profile = Profile.model_validate(document)
    except ValidationError as err:
        raise UsageError(f"{name}, {_first_fault(err)}") from err
    if fault := contradiction(profile):
        raise UsageError(f"{name}, {fault}")
    return profile


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(below)
    for key, value in above.items():
        under = merged.get(key)
        merged[key] = _merged(under, value) if isinstance(under, Mapping) and isinstance(value, Mapping) else value
    return merged


def _first_fault(err: ValidationError) -> str:
    first, *more = err.errors(include_url=False, include_context=False)
    field = _printable(".".join(str(part) for part in first["loc"]))
    rest = f" (and {len(more)} more)" if more else ""
    return f"{field}: {_printable(field_fault(first, _shown))}{rest}"


def _shown(value: object) -> str:
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a number of thousands of digits
        return "a number that is far too long"
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


def _printable(text: str) -> str:
    return "".join(character if character.isprintable() else " " for character in text)
