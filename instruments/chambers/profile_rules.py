"""What the fields of a chamber profile must be to each other, beyond what each of them may be by itself."""

from __future__ import annotations

from collections.abc import Iterator

from benchctl_instruments.chambers.profile import (
    WORDS,
    BitSwitch,
    KeySwitch,
    Number,
    NumberKind,
    Profile,
    RegisterSwitch,
    Setting,
)

READ, WRITE_ONE, WRITE_SEVERAL = 3, 6, 16
RANGES: dict[NumberKind, tuple[float, float]] = {"u16": (0, 0xFFFF), "signed": (-0x8000, 0x7FFF), "f32": (-3e38, 3e38)}


def contradiction(profile: Profile) -> str:
    """The first thing that cannot be, in words that begin with the field; empty where there is none."""
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
    """Registers that would have to be two things; one that is twice the same is fine."""
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
    """Every number of a profile, with the name of its field."""
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
    """Every single register of a profile that holds no number, with the name of its field."""
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
