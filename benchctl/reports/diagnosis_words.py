"""A diagnosis in words: its verdict, coordinates, places, sizes and chances as a reader of the page expects them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Literal

from benchctl.diagnosis.result import COORDINATE_UNITS, Diagnosis, Estimate, Finding, Verdict, Where
from benchctl.reports import diagnosis_words as words
from benchctl.reports import text
from benchctl.reports.vocabulary import COORDINATES
from benchctl.reports.vocabulary import coordinate as coordinate
from benchctl.reports.vocabulary import unit as unit

NOT_OBSERVABLE = "not observable here"
_NEARLY_CERTAIN = 0.999
_LARGE = 1000.0
_DIGITS_OF_A_RANGE = 2


_PREFIXED = ("V", "N\u00a0m", "K")
_COUNTS = ("no", "one", "two", "three", "four", "five")
_NAMES = re.compile(r"(?<![\w/])(?:" + "|".join(sorted(COORDINATES, key=len, reverse=True)) + r")\b(?!\s*=)")


def coordinate_axis(name: str, output_unit: str) -> str:
    """A coordinate with its unit, as an axis is labelled."""
    unit = coordinate_unit(name, output_unit)
    return f"{coordinate(name)} ({unit})" if unit else coordinate(name)


def coordinate_unit(name: str, output_unit: str) -> str:
    """The unit of a coordinate as it is printed; empty where it has none. That of the output is the part's."""
    return output_unit if name == "output" else text.unit_text(COORDINATE_UNITS.get(name, "1"))


def prose(told: str) -> str:
    """A sentence of the engine's as a page prints it: coordinates in words, a true minus sign."""
    joined = re.sub(r"\b[a-z_]+(?:\*[a-z_]+)+", lambda found: _the(found[0]), told.replace("`", ""))
    named = _NAMES.sub(lambda found: _the(found[0]) if "_" in found[0] else found[0], joined)
    return text.raised(re.sub(r"(?<![\w.+−-])-(?=\d)", "−", named))


def listed(names: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return " and ".join(part for part in (", ".join(names[:-1]), *names[-1:]) if part)


def counted(count: int, what: str) -> str:
    """`one effect`, `two effects`, `7 effects`."""
    return f"{_COUNTS[count] if count < len(_COUNTS) else count} {what}{'' if count == 1 else 's'}"


def place(where: Where, output_unit: str, share_of: str = "what the noise does not account for") -> str:
    """Where a mismatch lives, in a sentence; `share_of` says of what the ranges hold a share."""
    told = f"Seen along: {coordinate(where.coordinate)}"
    if where.ranges:
        told += f", {_ranges(where, output_unit)}"
    if where.share_of_excess > 0:
        told += f"; {text.percent(100 * where.share_of_excess)} of {share_of} lies there"
    if where.steps:
        told += f". Largest in: {', '.join(dict.fromkeys(where.steps))}"
    return f"{told}."


def probability(value: float) -> str:
    """A probability in percent, without claiming certainty."""
    if value > _NEARLY_CERTAIN:
        return "> 99.9\u00a0%"
    return "< 0.1\u00a0%" if value < 1 - _NEARLY_CERTAIN else text.plain(100 * value, "%")


def estimate(value: Estimate) -> str:
    """A value with half its 95 % interval; as it stands where it was chosen, not measured."""
    shown = unit(value.unit)
    half = (value.high - value.low) / 2
    if not half > 0 or not math.isfinite(half):
        return text.with_unit(text.number(value.value, 4), shown) if half else text.plain(value.value, shown, 6)
    return text.with_uncertainty(value.value, half, shown)


def interval(value: Estimate) -> str:
    """The ends of a 95 % interval; a dash where the value was chosen."""
    if not math.isfinite(value.high - value.low):
        return NOT_OBSERVABLE
    return text.interval(value.low, value.high) if value.high > value.low else text.NOT_KNOWN


def change(value: Estimate) -> str:
    """By how much a parameter differs from what it was, in its standard errors and relatively."""
    if value.was is None:
        return "was not in the model"
    standard = standard_error(value)
    if not math.isfinite(standard):
        return NOT_OBSERVABLE
    moved = value.value - value.was
    told = f"{text.number(moved / standard, 2)} standard errors" if standard > 0 else text.NOT_KNOWN
    return f"{told}, {text.percent(100 * moved / value.was)}" if value.was else told


def standard_error(value: Estimate) -> float:
    """That of an estimate, from its 95 % interval."""
    return (value.high - value.low) / 3.92


def times_noise(rms: float, noise: float) -> str:
    """An rms as a multiple of the noise: `1.01 × the noise`."""
    return f"{rms / noise:.{2 if rms < 10 * noise else 0}f} × the noise" if noise > 0 else text.NOT_KNOWN


def likelihood(value: float) -> str:
    """A difference of twice the log likelihood: to one decimal where it is small."""
    if not math.isfinite(value):
        return text.NOT_KNOWN
    return text.count(round(value)) if abs(value) >= _LARGE else text.plain(value)


def scaled(unit: str, size: float) -> tuple[float, str]:
    """The factor and the unit in which a size of so many `unit` reads well: mV and µV, else thousandths."""
    if not size > 0 or not math.isfinite(size) or size >= 1:
        return 1.0, unit
    if unit in _PREFIXED:
        return (1e3, f"m{unit}") if size >= 1e-3 else (1e6, f"µ{unit}")
    return (1.0, unit) if size >= 0.1 else (1e3, f"0.001 {unit}")


def size(value: float, unit: str) -> str:
    """A size of the diagnosed quantity to three significant digits, in the multiple of its unit that reads well."""
    factor, shown = scaled(unit, abs(value))
    if shown.startswith("0.001"):
        factor, shown = 1.0, unit
    return text.with_unit(text.number(value * factor, 3), shown)


def _the(name: str) -> str:
    """A coordinate as it stands in a sentence; words that are none stay as they are."""
    parts = name.split("*")
    return " together with ".join(f"the {COORDINATES[part]}" for part in parts) if _known(parts) else name


def _known(parts: Sequence[str]) -> bool:
    return all(part in COORDINATES for part in parts)


def _ranges(where: Where, output_unit: str) -> str:
    """Ranges to as many decimals as tell the ends of the shortest one apart."""
    finite = [high - low for low, high in where.ranges if math.isfinite(high - low) and high > low]
    decimals = max(0, _DIGITS_OF_A_RANGE - 1 - math.floor(math.log10(min(finite)))) if finite else 3
    told = [_range(low, high, decimals) for low, high in where.ranges]
    return text.with_unit(listed(told), coordinate_unit(where.coordinate.split("*")[0], output_unit))


def _range(low: float, high: float, decimals: int) -> str:
    if not math.isfinite(low):
        return f"below {text.number(high)}"
    if not math.isfinite(high):
        return f"above {text.number(low)}"
    return text.span(low, high, "", decimals)


Kind = Literal["physics", "noise", "data"]

WANDERING = ("bias_random_walk", "flicker_noise")
GROWING = "noise_rate_dependent"

_KINDS: Mapping[str, Kind] = {
    **dict.fromkeys(("outliers", "dropouts", "adc_coarse", "saturation", "two_rails", "counter_wrap"), "data"),
    **dict.fromkeys((*WANDERING, GROWING), "noise"),
}
_VERDICTS: Mapping[Verdict, str] = {
    "consistent": "Consistent",
    "recalibrate": "Recalibrate",
    "missing-physics": "Physics is missing",
    "unknown-structure": "Unknown structure",
}
_ONLY: Mapping[Kind, str] = {"physics": "Physics is missing", "noise": "Noise not as modelled", "data": "Faulty data"}
_MOVED_ERRORS = 5.0


def kind_of(effect: str) -> Kind:
    """Whether a finding is of the physics, of the noise, or a fault of the data."""
    return _KINDS.get(effect, "physics")


def title(effect: str) -> str:
    """An identifier in plain letters: `thermal_lag` becomes thermal lag."""
    return effect.replace("_", " ")


def chip(diagnosis: Diagnosis) -> str:
    """The verdict in two or three words."""
    kinds: list[Kind] = sorted({kind_of(one.effect) for one in diagnosis.findings})
    return _ONLY[kinds[0]] if len(kinds) == 1 else _VERDICTS[diagnosis.verdict]


def headline(diagnosis: Diagnosis) -> str:
    """The verdict for someone who was not there, without the findings' own sentences."""
    if not diagnosis.findings and not diagnosis.unexplained.significant:
        return diagnosis.says
    told = [
        f"{beginning}: {names}."
        for kind, beginning in (
            ("physics", "The data demand physics that the model does not have"),
            ("noise", "The noise is not what the model says"),
            ("data", "The data have faults, which are left out of all figures"),
        )
        if (names := _names(diagnosis.findings, kind))
    ]
    if diagnosis.unexplained.significant:
        also = "Beside that something" if told else "Something"
        told.append(f"{also} is left that is not noise, and no known effect accounts for it.")
    return " ".join(told)


def moved(diagnosis: Diagnosis) -> dict[str, Estimate]:
    """Those parameters of the lab's model that are surely not what they were."""
    return {
        name: one
        for name, one in diagnosis.baseline.items()
        if one.was is not None and abs(one.value - one.was) > _MOVED_ERRORS * words.standard_error(one)
    }


def changed(diagnosis: Diagnosis) -> bool:
    """Whether what is left differs before and after: faults of the data are left out in both."""
    return bool(diagnosis.unexplained.models) or any(kind_of(one.effect) != "data" for one in diagnosis.findings)


def predicts_otherwise(diagnosis: Diagnosis) -> bool:
    """Whether the model with the findings predicts other samples; noise that only grows changes what they weigh."""
    return bool(diagnosis.unexplained.models) or any(
        kind_of(one.effect) == "physics" or one.effect in WANDERING for one in diagnosis.findings
    )


def _names(findings: Sequence[Finding], kind: str) -> str:
    return words.listed(list(dict.fromkeys(title(one.effect) for one in findings if kind_of(one.effect) == kind)))
