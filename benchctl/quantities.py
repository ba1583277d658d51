"""Numbers with a unit, as a person writes them: `90min` where the name says seconds. Nothing is guessed.

The name of a number states its unit by its ending (`soak_s`, `rate_dps`); a bare number is in that unit, and one with
another unit of the same kind is converted, exactly. What is kept and recorded is the plain number in the stated unit.
Of a temperature the name also says whether it is one on the scale or a difference; where it does not, only °C will do,
in which both are the same number.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction

from benchctl.limits import shown
from benchctl_instruments.errors import UsageError

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
"""The unit that a name states, by its ending; the first that fits. `degC` is a temperature on the scale, `K` the
difference of two, `degC or K` one of them, and the words of the name say which."""

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
_SCALES = {
    **dict.fromkeys(("degC", "celsius"), (Fraction(1), Fraction(0))),
    **dict.fromkeys(("K", "kelvin"), (Fraction(1), Fraction(-27315, 100))),
    **dict.fromkeys(("degF", "fahrenheit"), (Fraction(5, 9), Fraction(-160, 9))),
}
"""By what a temperature is multiplied, and what is added, to be one in °C."""

_WRITTEN = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*", re.DOTALL)
_LONGEST = 100
_LARGEST, _SMALLEST = 1e300, 1e-300


def unit_stated(name: str) -> str:
    """The unit that a name states by its ending, one of `ENDINGS`; empty where it states none.

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
    """The number that a text stands for, in a unit: bare, or with any unit of the same kind.

    The unit is one that `unit_stated` gives, or any that pint knows; where it is empty, only a bare number will do.

    Raises
    ------
    UsageError
        No finite number, or a unit that is none of that kind; says what would do.

    >>> quantity("90min", "s"), quantity("1", "s"), quantity("68 °F", "degC"), quantity("1 °C/min", "K/min")
    (5400.0, 1.0, 20.0, 1.0)
    """
    found = _WRITTEN.fullmatch(text.replace("−", "-")) if len(text) <= _LONGEST else None
    if found is None or not math.isfinite(number := float(found[1])):
        raise UsageError(_expected(unit, text))
    if not found[2]:
        return number
    if not unit:
        raise UsageError(f"{_expected(unit, text)}: its name states no unit")
    if number and not _SMALLEST < abs(number) < _LARGEST:  # its digits are too many to be exact about
        raise UsageError(f"expected a number of ordinary size, got {shown(text)}")
    return _in_unit(Fraction(found[1]) if number else Fraction(0), found[2], unit, text)


def named_quantity(text: str, name: str) -> float:
    """The number that a text stands for, in the unit that a name states; raises what `quantity` does, with the name."""
    try:
        return quantity(text, unit_stated(name))
    except UsageError as err:
        raise UsageError(f"{name}: {err}") from err


def _in_unit(number: Fraction, written: str, unit: str, text: str) -> float:
    from benchctl.units import exact_factor, spelled

    written = spelled(written)
    if unit == "degC or K":
        if written not in ("degC", "celsius"):
            raise UsageError(
                f"expected a bare number or one in degC, got {shown(text)}: whether it is a temperature or a "
                "difference is not said by its name, and in degC alone both are the same number"
            )
        return float(number)
    if unit == "degC":
        if written not in _SCALES:
            raise UsageError(_expected(unit, text))
        factor, offset = _SCALES[written]
        return float(factor * number + offset)
    try:
        return float(number * exact_factor(written, unit))
    except (ValueError, OverflowError) as err:
        raise UsageError(_expected(unit, text)) from err


def _expected(unit: str, text: str) -> str:
    number = f"number in {unit}, bare or with a unit ({_ALSO.get(unit, unit)})" if unit else "bare number"
    return f"expected a {number}, got {shown(text)}"
