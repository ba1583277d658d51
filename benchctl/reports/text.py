"""Formatting of numbers, units and durations for reports.

A value with an uncertainty is rounded to two significant digits of the uncertainty (GUM 7.2.6). All interfaces of
benchctl print it by `with_uncertainty`. The minus sign is U+2212; no line breaks before a unit.
"""

from __future__ import annotations

import math
import re
from typing import TypeGuard

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_NO_SPACE_BEFORE = ("°", "″")
_SMALLEST_PLAIN, _LARGEST_PLAIN = 1e-3, 1e5
_PLAIN_UNCERTAINTY, _LARGEST_STATED = 1e-5, 1e6
_MOST_DECIMALS = 12

NOT_KNOWN = "–"
"""Printed in place of an unknown number."""


def number(value: float | None, digits: int = 3) -> str:
    """Format a number to `digits` significant digits, with a power of ten if it is very small or very large."""
    if value is None or not math.isfinite(value):
        return NOT_KNOWN
    order = _order(abs(value), digits)
    exponent = 0 if value == 0 or _SMALLEST_PLAIN <= 10.0**order < _LARGEST_PLAIN else order
    scaled = value / 10.0**exponent
    decimals = digits - 1 - _order(abs(scaled), digits)
    return _minus(f"{scaled:.{min(max(decimals, 0), _MOST_DECIMALS)}f}") + _times_ten_to(exponent)


def with_uncertainty(value: float, expanded: float | None, unit: str = "") -> str:
    """Format a value as `(0.05000 ± 0.00012) V` or `(50.0012 ± 0.0034) × 10⁻³ V`; without uncertainty to six digits.

    The power of ten is a multiple of three. It is used if the uncertainty is below 10⁻⁵, or if the larger of both is
    below 10⁻³ or at least 10⁶.
    """
    if not _is_uncertainty(expanded):
        return with_unit(number(value, 6), unit)
    exponent, decimals = _rounding(value, expanded)
    parts = [_fixed(part / 10.0**exponent, decimals) for part in (value, expanded)]
    text = f"{parts[0]} ± {parts[1]}"
    if exponent or unit:
        text = f"({text}){_times_ten_to(exponent)}"
    return with_unit(text, unit)


def interval(low: float, high: float) -> str:
    """Format an interval as `[3.008, 3.032] × 10⁻⁶`, rounded with half its width as the uncertainty."""
    half = (high - low) / 2
    if not _is_uncertainty(half):
        return f"[{number(low, 6)}, {number(high, 6)}]"
    exponent, decimals = _rounding((low + high) / 2, half)
    ends = [_fixed(end / 10.0**exponent, decimals) for end in (low, high)]
    return f"[{ends[0]}, {ends[1]}]{_times_ten_to(exponent)}"


def percent(value: float | None) -> str:
    """Format with two significant digits and the sign: `0.046 %`."""
    return NOT_KNOWN if value is None or not math.isfinite(value) else with_unit(number(value, 2), "%")


def count(value: int) -> str:
    """Format a count, with narrow spaces between thousands."""
    return f"{value:,}".replace(",", "\u202f")


def plain(value: float | None, unit: str = "", decimals: int = 1) -> str:
    """Format a number with at most `decimals` decimals, without trailing zeros, and its unit."""
    if value is None or not math.isfinite(value):
        return NOT_KNOWN
    rounded = f"{value:.{decimals}f}"
    text = rounded.rstrip("0").rstrip(".") if decimals else rounded
    return with_unit(_minus("0" if text == "-0" else text), unit)


def span(low: float, high: float, unit: str, decimals: int = 1) -> str:
    """Format a range as `−40 to 60 °C`, or as one number if both ends print alike."""
    ends = [plain(end, "", decimals) for end in (low, high)]
    return with_unit(ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}", unit)


def duration(seconds: float) -> str:
    """Format a duration: `32 h 14 min`, `3 min 20 s`, `12 s`."""
    rounded = round(seconds)
    if rounded >= 3600:
        return f"{rounded // 3600}\u00a0h {rounded % 3600 // 60:02d}\u00a0min"
    if rounded >= 60:
        return f"{rounded // 60}\u00a0min {rounded % 60:02d}\u00a0s"
    return f"{rounded}\u00a0s"


def with_unit(text: str, unit: str) -> str:
    """Join a number's text and its unit by a no-break space; no space before degrees and seconds of arc."""
    space = "" if not unit or unit in _NO_SPACE_BEFORE else "\u00a0"
    return f"{text}{space}{unit}"


def unit_text(unit: str) -> str:
    """Return a unit as printed: `V/(deg/s)` becomes `V/(°/s)`, `°C^-2` and `degC-2` become `°C⁻²`, `1` nothing."""
    if unit == "1":
        return ""
    printed = re.sub(r"degree s-(\d)", r"deg/s\1", unit)
    for name, sign in (("degC", "°C"), ("arcsec", "″"), ("degree", "°"), ("deg", "°"), ("**", "^")):
        printed = printed.replace(name, sign)
    return raised(re.sub(r"(?<=[A-Za-z°)])(-?\d+)", r"^\1", printed))


def scale_unit(output_unit: str) -> str:
    """Return the unit of a scale factor: output over rate; empty if the output is a rate itself."""
    return "" if output_unit == "°/s" else f"{output_unit}/(°/s)"


def raised(plain_text: str) -> str:
    """Return a sentence with superscript powers: `x^2` becomes x², `x^1` x, `5e-08` 5 × 10⁻⁸."""
    powers = re.sub(
        r"\^(-?\d+)", lambda found: "" if found[1] == "1" else found[1].translate(_SUPERSCRIPTS), plain_text
    )
    return re.sub(r"(?<=\d)e([-+]\d+)\b", lambda found: _times_ten_to(int(found[1])), powers)


def power(base: str, exponent: int) -> str:
    """Return a power as printed: ΔT, ΔT², …."""
    return raised(f"{base}^{exponent}")


def _is_uncertainty(value: float | None) -> TypeGuard[float]:
    return value is not None and math.isfinite(value) and value > 0


def _rounding(value: float, uncertainty: float) -> tuple[int, int]:
    """Return the power of ten to factor out, and the decimals for two significant digits of the uncertainty."""
    size = max(abs(value), uncertainty)
    plain = uncertainty >= _PLAIN_UNCERTAINTY and _SMALLEST_PLAIN <= size < _LARGEST_STATED
    exponent = 0 if plain else 3 * math.floor(math.log10(size) / 3)
    decimals = 1 - _order(uncertainty / 10.0**exponent, 2)
    return exponent, min(decimals, _MOST_DECIMALS)


def _fixed(value: float, decimals: int) -> str:
    """Format a number with this many decimals; a negative number rounds to tens, hundreds, …."""
    return _minus(f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}")


def _order(size: float, digits: int) -> int:
    """Return the order of magnitude after rounding to this many digits: 0.0996 to two digits is 0.10."""
    return int(f"{size:.{digits - 1}e}".partition("e")[2]) if size else 0


def _times_ten_to(exponent: int) -> str:
    return f"\u00a0×\u00a010{str(exponent).translate(_SUPERSCRIPTS)}" if exponent else ""


def _minus(text: str) -> str:
    return text.replace("-", "−")
