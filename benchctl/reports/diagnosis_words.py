"""The text of a diagnosis: its verdict, coordinates, ranges, sizes and probabilities."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Literal

from benchctl.diagnosis.result import COORDINATE_UNITS, Diagnosis, Estimate, Finding, Verdict, Where
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
    """Return the label of an axis: a coordinate with its unit."""
    unit = coordinate_unit(name, output_unit)
    return f"{coordinate(name)} ({unit})" if unit else coordinate(name)


def coordinate_unit(name: str, output_unit: str) -> str:
    """Return the printed unit of a coordinate, empty if it has none. That of the output is the unit of the part."""
    return output_unit if name == "output" else text.unit_text(COORDINATE_UNITS.get(name, "1"))


def prose(sentence: str) -> str:
    """Return a sentence of the diagnosis as printed: coordinates in words, a true minus sign."""
    joined = re.sub(r"\b[a-z_]+(?:\*[a-z_]+)+", lambda found: _the(found[0]), sentence.replace("`", ""))
    named = _NAMES.sub(lambda found: _the(found[0]) if "_" in found[0] else found[0], joined)
    return text.raised(re.sub(r"(?<![\w.+−-])-(?=\d)", "−", named))


def listed(names: Sequence[str]) -> str:
    """Join names: `a`, `a and b`, `a, b and c`."""
    return " and ".join(part for part in (", ".join(names[:-1]), *names[-1:]) if part)


def counted(count: int, what: str) -> str:
    """Format a count: `one effect`, `two effects`, `7 effects`."""
    return f"{_COUNTS[count] if count < len(_COUNTS) else count} {what}{'' if count == 1 else 's'}"


def place(where: Where, output_unit: str, share_of: str = "what the noise does not account for") -> str:
    """Return where a mismatch occurs, as a sentence; `share_of` names the quantity that the ranges hold a share of."""
    description = f"Depends on: {coordinate(where.coordinate)}"
    if where.ranges:
        description += f", {_ranges(where, output_unit)}"
    if where.share_of_excess > 0:
        description += f"; {text.percent(100 * where.share_of_excess)} of {share_of} lies there"
    if where.steps:
        description += f". Largest in: {', '.join(dict.fromkeys(where.steps))}"
    return f"{description}."


def probability(value: float) -> str:
    """Return a probability in percent, never as 0 % or 100 %."""
    if value > _NEARLY_CERTAIN:
        return "> 99.9\u00a0%"
    return "< 0.1\u00a0%" if value < 1 - _NEARLY_CERTAIN else text.plain(100 * value, "%")


def estimate(value: Estimate) -> str:
    """Return a value ± half its 95 % interval; a value that was chosen, not measured, is printed without."""
    shown = unit(value.unit)
    half = (value.high - value.low) / 2
    if not half > 0 or not math.isfinite(half):
        return text.with_unit(text.number(value.value, 4), shown) if half else text.plain(value.value, shown, 6)
    return text.with_uncertainty(value.value, half, shown)


def interval(value: Estimate) -> str:
    """Return the ends of a 95 % interval; a dash if the value was chosen."""
    if not math.isfinite(value.high - value.low):
        return NOT_OBSERVABLE
    return text.interval(value.low, value.high) if value.high > value.low else text.NOT_KNOWN


def change(value: Estimate) -> str:
    """Return the change of a parameter from its former value, in standard errors and relative."""
    if value.was is None:
        return "was not in the model"
    standard = standard_error(value)
    if not math.isfinite(standard):
        return NOT_OBSERVABLE
    moved = value.value - value.was
    errors = f"{text.number(moved / standard, 2)} standard errors" if standard > 0 else text.NOT_KNOWN
    return f"{errors}, {text.percent(100 * moved / value.was)}" if value.was else errors


def standard_error(value: Estimate) -> float:
    """Return the standard error of an estimate, from its 95 % interval."""
    return (value.high - value.low) / 3.92


def times_noise(rms: float, noise: float) -> str:
    """Return an rms as a multiple of the noise: `1.01 × the noise`."""
    return f"{rms / noise:.{2 if rms < 10 * noise else 0}f} × the noise" if noise > 0 else text.NOT_KNOWN


def likelihood(value: float) -> str:
    """Return a difference of twice the log likelihood, to one decimal if it is small."""
    if not math.isfinite(value):
        return text.NOT_KNOWN
    return text.count(round(value)) if abs(value) >= _LARGE else text.plain(value)


def scaled(unit: str, size: float) -> tuple[float, str]:
    """Return the factor and the unit in which `size` is readable: mV and µV, else thousandths."""
    if not size > 0 or not math.isfinite(size) or size >= 1:
        return 1.0, unit
    if unit in _PREFIXED:
        return (1e3, f"m{unit}") if size >= 1e-3 else (1e6, f"µ{unit}")
    return (1.0, unit) if size >= 0.1 else (1e3, f"0.001 {unit}")


def size(value: float, unit: str) -> str:
    """Return a size of the diagnosed quantity to three significant digits, with a suitable prefix."""
    factor, shown = scaled(unit, abs(value))
    if shown.startswith("0.001"):
        factor, shown = 1.0, unit
    return text.with_unit(text.number(value * factor, 3), shown)


def _the(name: str) -> str:
    """Return a coordinate as written in a sentence; other words are returned unchanged."""
    parts = name.split("*")
    return " together with ".join(f"the {COORDINATES[part]}" for part in parts) if _known(parts) else name


def _known(parts: Sequence[str]) -> bool:
    return all(part in COORDINATES for part in parts)


def _ranges(where: Where, output_unit: str) -> str:
    """Return ranges with enough decimals to distinguish the ends of the shortest one."""
    finite = [high - low for low, high in where.ranges if math.isfinite(high - low) and high > low]
    decimals = max(0, _DIGITS_OF_A_RANGE - 1 - math.floor(math.log10(min(finite)))) if finite else 3
    ranges = [_range(low, high, decimals) for low, high in where.ranges]
    return text.with_unit(listed(ranges), coordinate_unit(where.coordinate.split("*")[0], output_unit))


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
    """Return the category of a finding: physics, noise, or a fault of the data."""
    return _KINDS.get(effect, "physics")


def title(effect: str) -> str:
    """Return an identifier without underscores: `thermal_lag` becomes thermal lag."""
    return effect.replace("_", " ")


def chip(diagnosis: Diagnosis) -> str:
    """Return the verdict in two or three words."""
    kinds: list[Kind] = sorted({kind_of(one.effect) for one in diagnosis.findings})
    return _ONLY[kinds[0]] if len(kinds) == 1 else _VERDICTS[diagnosis.verdict]


def headline(diagnosis: Diagnosis) -> str:
    """Return a summary of the verdict, without the sentences of the findings."""
    if not diagnosis.findings and not diagnosis.unexplained.significant:
        return diagnosis.says
    sentences = [
        f"{beginning}: {names}."
        for kind, beginning in (
            ("physics", "The data demand physics that the model does not have"),
            ("noise", "The noise differs from the model"),
            ("data", "The data have faults, which are left out of all figures"),
        )
        if (names := _names(diagnosis.findings, kind))
    ]
    if diagnosis.unexplained.significant:
        also = "A further part of the residual" if sentences else "The residual"
        sentences.append(f"{also} is not noise, and no known effect accounts for it.")
    return " ".join(sentences)


def moved(diagnosis: Diagnosis) -> dict[str, Estimate]:
    """Return the parameters of the lab's model that have changed significantly."""
    return {
        name: one
        for name, one in diagnosis.baseline.items()
        if one.was is not None and abs(one.value - one.was) > _MOVED_ERRORS * standard_error(one)
    }


def changed(diagnosis: Diagnosis) -> bool:
    """Return whether the residual differs before and after: faults of the data are left out in both."""
    return bool(diagnosis.unexplained.models) or any(kind_of(one.effect) != "data" for one in diagnosis.findings)


def predicts_otherwise(diagnosis: Diagnosis) -> bool:
    """Return whether the model with the findings predicts other samples; rate-dependent noise changes only weights."""
    return bool(diagnosis.unexplained.models) or any(
        kind_of(one.effect) == "physics" or one.effect in WANDERING for one in diagnosis.findings
    )


def _names(findings: Sequence[Finding], kind: str) -> str:
    return listed(list(dict.fromkeys(title(one.effect) for one in findings if kind_of(one.effect) == kind)))
