"""Structures without a name in C: their parameters as macros, their functions as expressions of `x`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # loads interpolate on first use

from benchctl.calibration.discovered import Discovered
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.structure_shapes import EDGE
from benchctl_instruments.physics.structures import Structure

_EXPRESSIONS: Mapping[str, str] = {
    "step": "{change} * gyro_ramp(x, {at}, {width})",
    "step_below": "{change} * gyro_ramp(-x, -{at}, {width})",
    "steps": "{change} * gyro_ramp(x, {at}, {width}) + {change_2} * gyro_ramp(x, {at_2}, {width})",
    "jump": "(x >= {at} ? {change} : 0.0)",
    "plateau": "{change} * (gyro_ramp(x, {at}, {edge} * {length}) - gyro_ramp(x, {at} + {length}, {edge} * {length}))",
    "kink": "{above} * fmax(x - {at}, 0.0)",
    "kink_below": "{below} * fmin(x - {at}, 0.0)",
    "power": "{change} * pow(fmax(x - {at}, 0.0) / fmax({high} - {at}, 1e-9), {exponent})",
    "power_below": "{change} * pow(fmax({at} - x, 0.0) / fmax({at} - {low}, 1e-9), {exponent})",
    "bend": "{below} * fmin(x - {at}, 0.0) + {above} * fmax(x - {at}, 0.0)",
    "bump": "{change} * exp(-0.5 * ((x - {at}) / {width}) * ((x - {at}) / {width}))",
    "resonance": "{change} / (1.0 + ((x - {at}) / {width}) * ((x - {at}) / {width}))",
    "wave": "{cosine} * cos(GYRO_TURN / {period} * x) + {sine} * sin(GYRO_TURN / {period} * x)",
    "line": "{c1} * x",
    "parabola": "({c1} + {c2} * x) * x",
    "cubic": "({c1} + ({c2} + {c3} * x) * x) * x",
    "rise": "{change} * exp(fmin((x - {high}) / {tau}, 0.0))",
    "fall": "{change} * exp(fmin(({low} - x) / {tau}, 0.0))",
    "negative": "(x < 0.0 ? {change} : 0.0)",
    "positive": "(x > 0.0 ? {change} : 0.0)",
    "either": "(x != 0.0 ? {change} : 0.0)",
}
_COORDINATES = {
    "gyro_temp": "celsius",
    "rate": "rate_dps",
    "abs_rate": "fabs(rate_dps)",
    "rate_sign": "gyro_direction(rate_dps)",
    "output": "output_v",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class CStructure:
    """A structure in C.

    `constants` are name, value and unit of its macros; `pieces` are those of a cubic spline: the start of each, and its
    coefficients from the third power down. `expression` is its function of `x`, which is `coordinate`; it is multiplied
    by `times` unless that is empty.
    """

    says: str
    acts_on: str
    constants: Sequence[tuple[str, float, str]]
    pieces: Sequence[Sequence[float]]
    table: str
    coordinate: str
    times: str
    expression: str

    @property
    def text(self) -> str:
        """All expressions of the structure, from which the required functions are determined."""
        return f"{self.coordinate} {self.times} {self.expression}"


def c_structures(discovered: Discovered) -> list[CStructure]:
    """Return the structures to be subtracted from the output; raise `UsageError` for a shape without a C version."""
    return [_in_c(number, name, one) for number, (name, one) in enumerate(discovered.structures.items(), start=1)]


def _in_c(number: int, named: str, one: Structure) -> CStructure:
    prefix = f"GYRO_STRUCTURE{number}_"
    names = {parameter: f"{prefix}{parameter.upper()}" for parameter in one.parameters}
    stated: Sequence[str] = tuple(one.parameters)
    table, pieces = "", list[list[float]]()
    if one.shape.startswith("spline"):
        stated, table, pieces = ("low", "high"), f"gyro_structure{number}_pieces", _pieces(one)
        expression = f"gyro_spline({table}, {len(pieces)}, fmin(fmax(x, {names['low']}), {names['high']}))"
    elif one.shape in _EXPRESSIONS:
        expression = _EXPRESSIONS[one.shape].format(**names, edge=EDGE)
    else:
        raise UsageError(f"{named}: the shape {one.shape} is not written in C; export --to json")
    return CStructure(
        says=_plain(one.says()),
        acts_on=one.acts_on,
        constants=[(names[name], one.values[name], one.parameters[name].unit) for name in stated],
        pieces=pieces,
        table=table,
        coordinate=_COORDINATES[one.over],
        times=_COORDINATES[one.times] if one.times else "",
        expression=expression,
    )


def _plain(text: str) -> str:
    for sign, word in (("°C", "degC"), ("°/s", "deg/s"), ("°", " deg"), ("±", "+-")):
        text = text.replace(sign, word)
    return text


def _pieces(one: Structure) -> list[list[float]]:
    values = [one.values[name] for name in one.parameters if name not in ("low", "high")]
    knots = np.linspace(one.values["low"], one.values["high"], len(values))
    curve = scipy.interpolate.make_interp_spline(knots, values, k=3)
    cubic = scipy.interpolate.PPoly.from_spline((curve.t, curve.c, curve.k))
    begins = zip(cubic.x[:-1].tolist(), cubic.x[1:].tolist(), cubic.c.T.tolist(), strict=True)
    return [[begin, *powers] for begin, end, powers in begins if end > begin]
