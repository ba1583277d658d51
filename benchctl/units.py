"""Units of measure as people write them, by pint, which is imported only where one is met."""

from __future__ import annotations

import re
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from benchctl.limits import cut

if TYPE_CHECKING:
    import pint

_LONGEST = 60
_SPELLING = re.compile(r"(?:(?:[A-Za-z_]++|\))(?:(?:\^|\*\*)-?\d(?:\.\d)?)?|[( ]|/(?!/)|\*(?!\*)|1)+")
"""Words, brackets, products, quotients and small powers: nothing that could take long to work out."""

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
"""What pint raises of texts beside its own errors; an assertion fails of an operator with nothing behind it."""
_SCALES = re.compile(r"\bdeg([CF])\b")


def factor_between(unit: str, other: str) -> float:
    """By what a number in one unit is multiplied to be in another.

    Degrees Celsius and Fahrenheit are those of a difference: scales with another zero have no factor.

    Raises
    ------
    ValueError
        Where the other is no unit, or one of something else; in words.

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
    """`factor_between` as a ratio of whole numbers; that of π is its first fifty digits."""
    import tokenize

    import pint

    try:
        ours, theirs = (_registry().Quantity(Fraction(1), _unit(text)) for text in (unit, other))
        if ours.to_root_units().units != theirs.to_root_units().units:  # for pint an angle is but a number: rad/s is Hz
            raise ValueError(other)
        return Fraction(ours.to(theirs.units).magnitude)
    except (pint.PintError, *_PINTS_OWN, tokenize.TokenError) as err:
        raise ValueError(_none_of(unit, other)) from err


def spelled(text: str) -> str:
    """A unit in letters: ° and %, small raised figures and the like as pint knows them.

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
