"""Units of measure by pint, and numbers with a unit, such as `90min` for a name that states seconds.

The ending of a name states the unit of its number (`soak_s`, `rate_dps`). A bare number is in that unit; a number with
another unit of the same kind is converted exactly. Stored and recorded is the plain number in the stated unit.
For a temperature, the name also states whether it is a point on the scale or a difference; otherwise only °C is
accepted, in which both are the same number. pint is imported only when a unit occurs.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from benchctl.limits import cut, shown
from benchctl_instruments.errors import UsageError

if TYPE_CHECKING:
    import pint

_LONGEST = 60
_SPELLING = re.compile(r"(?:(?:[A-Za-z_]++|\))(?:(?:\^|\*\*)-?\d(?:\.\d)?)?|[( ]|/(?!/)|\*(?!\*)|1)+")
"""Words, brackets, products, quotients and small powers, all of which are fast to evaluate."""

_SIGNS = {
    "℃": "degC",
    "℉": "degF",
    "°C": "degC",
    "°F": "degF",
    "°": "deg",
    "′": "arcmin",
    "″": "arcsec",
    "%": "percent",
    "µ": "u",
    "μ": "u",
    "²": "^2",
    "³": "^3",
    "⁻¹": "^-1",
    "⁻²": "^-2",
    "·": "*",
    "Ω": "ohm",
}
_SPELLED = re.compile("|".join(re.escape(sign) for sign in sorted(_SIGNS, key=len, reverse=True)))
_PINTS_OWN = (TypeError, ValueError, AttributeError, SyntaxError, AssertionError)
"""Exceptions of pint for invalid texts in addition to its own; an operator without an operand fails an assertion."""
_SCALES = re.compile(r"\bdeg([CF])\b")


def factor_between(unit: str, other: str) -> float:
    """Return the factor that converts a number in one unit to another.

    Degrees Celsius and Fahrenheit are treated as differences, since scales with different zeros have no factor.

    Raises
    ------
    ValueError
        If the other is not a unit, or a unit of another kind.

    >>> factor_between("deg/h", "deg/s") * 3600
    1.0
    """
    try:
        factor = float(exact_factor(unit, other))
    except OverflowError:
        factor = 0.0
    if factor <= 0.0:
        raise ValueError(_none_of(unit, other))
    return factor


def exact_factor(unit: str, other: str) -> Fraction:
    """Return `factor_between` as an exact fraction; π is represented by its first fifty digits."""
    import tokenize

    import pint

    try:
        ours, theirs = (_registry().Quantity(Fraction(1), _unit(text)) for text in (unit, other))
        if ours.to_root_units().units != theirs.to_root_units().units:  # pint treats an angle as a number: rad/s is Hz
            raise ValueError(other)
        return Fraction(ours.to(theirs.units).magnitude)
    except (pint.PintError, *_PINTS_OWN, tokenize.TokenError) as err:
        raise ValueError(_none_of(unit, other)) from err


def spelled(text: str) -> str:
    """Return a unit in the spelling of pint: signs such as °, % and superscripts are replaced by letters.

    >>> spelled("°/s²"), spelled("°C/min")
    ('deg/s^2', 'degC/min')
    """
    return _SPELLED.sub(lambda found: _SIGNS[found[0]], text).strip()


def _none_of(unit: str, other: str) -> str:
    return f"the unit {cut(other, _LONGEST)!r} is none of what is measured in {unit}"


def _unit(text: str) -> pint.Unit:
    word = re.sub(r"sqrt\(([^()]*)\)", r"(\1)**0.5", spelled(text))
    if len(word) > _LONGEST or not _SPELLING.fullmatch(word):
        raise ValueError(text)
    return _registry().parse_units(_SCALES.sub(r"delta_deg\1", word))


@lru_cache(maxsize=1)
def _registry() -> pint.UnitRegistry[Any]:
    import pint

    registry: pint.UnitRegistry[Any] = pint.UnitRegistry(cache_folder=None, non_int_type=Fraction)
    registry.define("dps = degree / second")
    return registry


ENDINGS: dict[str, str] = {
    "_c_per_min": "K/min",
    "_c_per_v": "K/V",
    "_v_per_dps": "V/(deg/s)",
    "_rad_per_dps": "rad/(deg/s)",
    "_deg_per_h": "deg/h",
    "_dps2": "deg/s^2",
    "_dps": "deg/s",
    "_arcsec": "arcsec",
    "_mrad": "mrad",
    "_deg": "deg",
    "_hz": "Hz",
    "_v_rms": "V",
    "_v": "V",
    "_ms": "ms",
    "_s": "s",
    "_ppm": "ppm",
    "_percent": "percent",
    "_c": "degC or K",
}
"""The unit that a name states by its ending; the first match applies. `degC` is a temperature on the scale, `K` a
difference of temperatures; for `degC or K`, the last word of the name decides."""

_ON_THE_SCALE = frozenset(
    (
        *("ambient", "at", "chamber", "cold", "coldest", "end", "from", "high", "hot", "hottest", "low", "points"),
        *("reference", "room", "setpoint", "start", "T0", "temperature", "temperatures", "to"),
    )
)
_DIFFERENCES = frozenset(
    ("band", "delta", "deviation", "difference", "error", "hysteresis", "margin", "span", "tolerance", "uncertainty")
)

_ALSO = {
    "deg/s": "deg/s, rad/s, deg/h or rpm",
    "deg/s^2": "deg/s^2 or rad/s^2",
    "s": "s, min, h or ms",
    "ms": "ms or s",
    "Hz": "Hz, mHz or kHz",
    "V": "V or mV",
    "V/(deg/s)": "V/(deg/s) or mV/(deg/s)",
    "deg": "deg, arcmin, arcsec or mrad",
    "arcsec": "arcsec, deg or mrad",
    "mrad": "mrad, deg or arcsec",
    "degC": "degC, K or degF",
    "K": "K, degC or degF",
    "K/min": "K/min, degC/min or K/s",
    "ppm": "ppm or %",
    "percent": "% or ppm",
}
_TO_CELSIUS = {
    **dict.fromkeys(("degC", "celsius"), (Fraction(1), Fraction(0))),
    **dict.fromkeys(("K", "kelvin"), (Fraction(1), Fraction(-27315, 100))),
    **dict.fromkeys(("degF", "fahrenheit"), (Fraction(5, 9), Fraction(-160, 9))),
}
"""Factor and offset that convert a temperature to °C."""

_WRITTEN = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*", re.DOTALL)
_LONGEST_TEXT = 100
_LARGEST, _SMALLEST = 1e300, 1e-300


def unit_stated(name: str) -> str:
    """Return the unit that a name states by its ending, one of `ENDINGS`; empty if it states none.

    >>> unit_stated("soak_s"), unit_stated("coldest_c"), unit_stated("tolerance_c"), unit_stated("points")
    ('s', 'degC', 'K', '')
    """
    for ending, unit in ENDINGS.items():
        if name.endswith(ending):
            if unit != "degC or K":
                return unit
            word = name.removesuffix(ending).split("_")[-1]
            return "degC" if word in _ON_THE_SCALE else "K" if word in _DIFFERENCES else unit
    return ""


def quantity(text: str, unit: str) -> float:
    """Convert a text to a number in `unit`; the text is a bare number, or has any unit of the same kind.

    `unit` is a result of `unit_stated`, or any unit of pint; if it is empty, only a bare number is accepted.

    Raises
    ------
    UsageError
        If the number is not finite, or its unit is of another kind; the message states what is expected.

    >>> quantity("90min", "s"), quantity("1", "s"), quantity("68 °F", "degC"), quantity("1 °C/min", "K/min")
    (5400.0, 1.0, 20.0, 1.0)
    """
    found = _WRITTEN.fullmatch(text.replace("−", "-")) if len(text) <= _LONGEST_TEXT else None
    if found is None or not math.isfinite(number := float(found[1])):
        raise UsageError(_expected(unit, text))
    if not found[2]:
        return number
    if not unit:
        raise UsageError(f"{_expected(unit, text)}: its name states no unit")
    if number and not _SMALLEST < abs(number) < _LARGEST:  # too many digits for an exact conversion
        raise UsageError(f"expected a number of ordinary size, got {shown(text)}")
    return _in_unit(Fraction(found[1]) if number else Fraction(0), found[2], unit, text)


def _in_unit(number: Fraction, written: str, unit: str, text: str) -> float:

    written = spelled(written)
    if unit == "degC or K":
        if written not in ("degC", "celsius"):
            raise UsageError(
                f"expected a bare number or one in degC, got {shown(text)}: whether it is a temperature or a "
                "difference is not clear from its name, and in degC both are the same number"
            )
        return float(number)
    if unit == "degC":
        if written not in _TO_CELSIUS:
            raise UsageError(_expected(unit, text))
        factor, offset = _TO_CELSIUS[written]
        return float(factor * number + offset)
    try:
        return float(number * exact_factor(written, unit))
    except (ValueError, OverflowError) as err:
        raise UsageError(_expected(unit, text)) from err


def _expected(unit: str, text: str) -> str:
    number = f"number in {unit}, bare or with a unit ({_ALSO.get(unit, unit)})" if unit else "bare number"
    return f"expected a {number}, got {shown(text)}"
