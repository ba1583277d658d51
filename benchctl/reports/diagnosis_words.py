"""A diagnosis in words: coordinates, places, sizes and chances as a reader of the page expects them."""

from __future__ import annotations

import math
from collections.abc import Mapping

from benchctl.diagnosis.result import COORDINATE_UNITS, Estimate, Verdict, Where
from benchctl.reports import text

VERDICTS: Mapping[Verdict, str] = {
    "consistent": "Consistent",
    "recalibrate": "Recalibrate",
    "missing-physics": "Physics is missing",
    "unknown-structure": "Unknown structure",
}

_COORDINATES: Mapping[str, str] = {
    "time": "time",
    "rate": "rate",
    "abs_rate": "|rate|",
    "rate_sign": "sense of rotation",
    "acceleration": "acceleration",
    "angle": "angle of the table",
    "gyro_temp": "gyro's temperature",
    "gyro_temp_rate": "change of the gyro's temperature",
    "chamber_temp": "chamber's temperature",
    "output": "output",
    "frequency": "frequency",
    "step": "number of the step",
}
_NEARLY_CERTAIN = 0.999


def coordinate(name: str) -> str:
    """A coordinate in words; of two joined by `*` both."""
    return " together with ".join(_COORDINATES.get(part, part.replace("_", " ")) for part in name.split("*"))


def coordinate_axis(name: str) -> str:
    """A coordinate with its unit, as an axis is labelled."""
    unit = coordinate_unit(name)
    return f"{coordinate(name)} ({unit})" if unit else coordinate(name)


def coordinate_unit(name: str) -> str:
    """The unit of a coordinate as it is printed; empty where it has none."""
    return text.unit_text(COORDINATE_UNITS.get(name, "1"))


def place(where: Where) -> str:
    """Where a mismatch lives, in a sentence."""
    told = f"Seen along: {coordinate(where.coordinate)}"
    if where.ranges:
        told += f", {_ranges(where)}"
    if where.share_of_excess > 0:
        told += f"; {text.percent(100 * where.share_of_excess)} of what the noise does not account for lies there"
    if where.steps:
        told += f". Largest in: {', '.join(where.steps)}"
    return f"{told}."


def probability(value: float) -> str:
    """A probability in percent, without claiming certainty."""
    if value > _NEARLY_CERTAIN:
        return "> 99.9\u00a0%"
    return "< 0.1\u00a0%" if value < 1 - _NEARLY_CERTAIN else text.plain(100 * value, "%")


def estimate(value: Estimate) -> str:
    """A value with half its 95 % interval; as it stands where it was chosen, not measured."""
    unit = text.unit_text(value.unit)
    half = (value.high - value.low) / 2
    if not half > 0 or not math.isfinite(half):
        return text.with_unit(text.number(value.value, 4), unit) if half else text.plain(value.value, unit, 6)
    return text.with_uncertainty(value.value, half, unit)


def interval(value: Estimate) -> str:
    """The ends of a 95 % interval; a dash where the value was chosen."""
    return text.interval(value.low, value.high) if value.high > value.low else text.NOT_KNOWN


def change(value: Estimate) -> str:
    """By how much a parameter differs from what it was, in its standard errors and relatively."""
    if value.was is None:
        return "was not in the model"
    standard = (value.high - value.low) / 3.92
    moved = value.value - value.was
    told = f"{text.number(moved / standard, 2)} standard errors" if standard > 0 else text.NOT_KNOWN
    return f"{told}, {text.percent(100 * moved / value.was)}" if value.was else told


def times_noise(rms: float, noise: float) -> str:
    """An rms as a multiple of the noise: `1.01 × the noise`."""
    return f"{rms / noise:.{2 if rms < 10 * noise else 0}f} × the noise" if noise > 0 else text.NOT_KNOWN


def scaled(unit: str, size: float) -> tuple[float, str]:
    """The factor and the unit in which a size of so many `unit` reads well: mV and µV, else thousandths."""
    if not size > 0 or not math.isfinite(size) or size >= 1:
        return 1.0, unit
    if unit == "V":
        return (1e3, "mV") if size >= 1e-3 else (1e6, "µV")
    return (1.0, unit) if size >= 0.1 else (1e3, f"0.001 {unit}")


def size(value: float, unit: str) -> str:
    """A size of the diagnosed quantity to three significant digits, in the multiple of its unit that reads well."""
    factor, shown = scaled(unit, abs(value))
    if " " in shown:
        factor, shown = 1.0, unit
    return text.with_unit(text.number(value * factor, 3), shown)


def _ranges(where: Where) -> str:
    unit = coordinate_unit(where.coordinate)
    return text.with_unit(" and ".join(_range(low, high) for low, high in where.ranges), unit)


def _range(low: float, high: float) -> str:
    if not math.isfinite(low):
        return f"below {text.number(high)}"
    if not math.isfinite(high):
        return f"above {text.number(low)}"
    ends = [text.number(end, 3) for end in (low, high)]
    return ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}"
