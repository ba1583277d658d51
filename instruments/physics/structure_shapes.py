"""Shapes of structures: their parameters, their function of a coordinate, and a sentence that describes it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import scipy  # scipy.interpolate is loaded at its first use

from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.physics.structure_places import ACTS, OVER, Span, StructureStage

EDGE = 0.01
"""Width of a plateau's edges relative to its length; sharp edges could not be fitted."""
_FACTOR_ABOVE = 2.0
"""Relative increase above which a sentence states a factor instead of a percentage."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeInWords:
    """A shape with its stage, its coordinate and its values: the words from which its sentence is composed."""

    stage: StructureStage
    over: str
    values: Mapping[str, float]
    times: str = ""

    @property
    def what(self) -> str:
        """The quantity that is changed, in words."""
        return ACTS[self.stage].what

    @property
    def along(self) -> str:
        """The coordinate, in words."""
        return OVER[self.over].phrase

    def size(self, value: float) -> str:
        """Return a change without its sign, in words."""
        factor, unit = ACTS[self.stage].printed
        per = f" per {OVER[self.times].printed or '1'} of {OVER[self.times].phrase}" if self.times else ""
        return f"{factor * abs(value):.3g} {unit}{per}"

    def change(self, name: str = "change") -> str:
        """Return a change with its direction, in words; a large relative change as a factor."""
        value = self.values[name]
        if ACTS[self.stage].printed[1] == "%" and value > _FACTOR_ABOVE:
            return f"{1.0 + value:.3g} times as large"
        return f"{self.size(value)} {'lower' if value < 0.0 else 'higher'}"

    def place(self, value: str | float = "at") -> str:
        """Return a value of the coordinate, or of the parameter of this name, with its unit."""
        number = self.values[value] if isinstance(value, str) else value
        return f"{number:.4g} {OVER[self.over].printed}".rstrip()

    def slope(self, name: str) -> str:
        """Return a change per unit of the coordinate, in words."""
        value, unit = self.values[name], OVER[self.over].printed or "1"
        return f"{'falls' if value < 0.0 else 'rises'} by {self.size(value)} per {unit}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """A shape: its parameters, its formula, its function of the coordinate x, and a sentence that describes it.

    Parameters are `sizes` with the power of x in their unit, `places` and `lengths` in the unit of x, `ends` of the
    range of x, which are not fitted, and `numbers` without a unit, with their bounds. With a `memory`, x is the
    coordinate after a first-order lag, or the difference between the coordinate after a backlash and the coordinate.
    """

    sizes: Mapping[str, int] = field(default_factory=lambda: {"change": 0})
    places: tuple[str, ...] = ()
    lengths: tuple[str, ...] = ()
    ends: tuple[Literal["low", "high"], ...] = ()
    numbers: Mapping[str, Span] = field(default_factory=dict)
    formula: str
    function: Callable[[Mapping[str, float], FloatArray], Any]
    sentence: Callable[[ShapeInWords], str]
    memory: Literal["", "lag", "backlash"] = ""

    def written(self, over: str, times: str = "") -> str:
        """Return the formula over a coordinate, multiplied by a second one if given."""
        written = self.formula.format(x=over)
        return f"({written})·{times}" if times else written


def _ramp(x: FloatArray, at: float, width: float) -> FloatArray:
    return np.clip((x - at) / width + 0.5, 0.0, 1.0)


def _plateau(p: Mapping[str, float], x: FloatArray) -> FloatArray:
    edge = EDGE * p["length"]
    return p["change"] * (_ramp(x, p["at"], edge) - _ramp(x, p["at"] + p["length"], edge))


def _bursts(p: Mapping[str, float], x: FloatArray) -> FloatArray:
    since = np.mod(x - p["at"], p["period"])
    edge = EDGE * p["length"]
    # half the edge of the next burst lies before its start
    return p["change"] * (_ramp(since, 0.0, edge) - _ramp(since, p["length"], edge) + _ramp(since, p["period"], edge))


def _wave(p: Mapping[str, float], x: FloatArray) -> FloatArray:
    turned = math.tau / p["period"] * x
    return p["cosine"] * np.cos(turned) + p["sine"] * np.sin(turned)


def _two_slopes(p: Mapping[str, float], x: FloatArray) -> FloatArray:
    return p.get("below", 0.0) * np.minimum(x - p["at"], 0.0) + p.get("above", 0.0) * np.maximum(x - p["at"], 0.0)


def _periodic(it: ShapeInWords) -> str:
    size = it.size(math.hypot(it.values["cosine"], it.values["sine"]))
    return f"The {it.what} follows a wave over {it.along}: ±{size}, with a period of {it.place('period')}."


def _peak(it: ShapeInWords) -> str:
    return (
        f"About {it.place()} of {it.along} the {it.what} is up to {it.change()}, within {it.place('width')}"
        " to either side."
    )


def _step(side: str, sign: float, formula: str) -> Shape:
    """Return a step on one side of a place, as a ramp over a width."""
    return Shape(
        places=("at",),
        lengths=("width",),
        formula=f"change·clip({formula}/width + ½, 0, 1)",
        function=lambda p, x: p["change"] * _ramp(sign * x, sign * p["at"], p["width"]),
        sentence=lambda it: (
            f"Where {it.along} is {side} {it.place()} the {it.what} is {it.change()}; the change takes"
            f" {it.place('width')} or less."
        ),
    )


def _kink(side: str, limited: str) -> Shape:
    """Return a shape that is zero on one side of a place and linear on the other."""
    return Shape(
        sizes={side: 1},
        places=("at",),
        formula=f"{side}·{limited}({{x}} − at, 0)",
        function=_two_slopes,
        sentence=lambda it: f"{side.capitalize()} {it.place()} of {it.along} the {it.what} {it.slope(side)}.",
    )


def _power(side: str, sign: float, end: Literal["low", "high"], formula: str) -> Shape:
    """Return a power of the distance from a place, on one side of it; its size is the value at the end of the range."""

    def function(p: Mapping[str, float], x: FloatArray) -> FloatArray:
        share = np.maximum(sign * (x - p["at"]), 0.0) / max(sign * (p[end] - p["at"]), 1e-9)
        return np.asarray(p["change"] * share ** p["exponent"])

    return Shape(
        places=("at",),
        ends=(end,),
        numbers={"exponent": (0.2, 5.0)},
        formula=f"change·(max({formula}, 0)/|{end} − at|)^exponent",
        function=function,
        sentence=lambda it: (
            f"{side.capitalize()} {it.place()} of {it.along} the {it.what} changes as the distance to the power"
            f" of {it.values['exponent']:.3g}: at {it.place(end)} it is {it.change()}."
        ),
    )


def _exponential(sign: float, end: Literal["low", "high"], formula: str, how: str) -> Shape:
    """Return a shape that grows by a factor e per length towards an end of its range and is constant beyond."""

    def function(p: Mapping[str, float], x: FloatArray) -> FloatArray:
        return np.asarray(p["change"] * np.exp(np.minimum(sign * (x - p[end]) / p["tau"], 0.0)))

    return Shape(
        lengths=("tau",),
        ends=(end,),
        formula=formula,
        function=function,
        sentence=lambda it: (
            f"The {it.what} changes exponentially as {it.along} {how}, by a factor e each {it.place('tau')}: at"
            f" {it.place(end)} it is {it.change()}."
        ),
    )


def _polynomial(degree: int, name: str) -> Shape:
    """Return a polynomial without a constant."""
    names = [f"c{i + 1}" for i in range(degree)]

    def sentence(it: ShapeInWords) -> str:
        terms = ", ".join(f"{one} = {it.values[one]:.3g}" for one in names)
        return f"The {it.what} follows a {name} over {it.along}: {terms}."

    return Shape(
        sizes={one: i + 1 for i, one in enumerate(names)},
        formula=" + ".join(f"{one}·{{x}}{('', '²', '³')[i]}" for i, one in enumerate(names)),
        function=lambda p, x: np.polynomial.polynomial.polyval(x, [0.0, *(p[one] for one in names)]),
        sentence=sentence,
    )


def _by_sign(number: int, relation: str, chosen: Callable[[FloatArray], BoolArray]) -> Shape:
    """Return a change where the coordinate is below zero, above zero, or not zero."""

    def sentence(it: ShapeInWords) -> str:
        directions = OVER[it.over].directions
        where = f"Where {it.along} is {('below', 'above', 'not')[number]} zero"
        return f"{where if directions is None else f'While {directions[number]}'} the {it.what} is {it.change()}."

    return Shape(
        formula=f"change·[{{x}} {relation} 0]", function=lambda p, x: p["change"] * chosen(x), sentence=sentence
    )


def _spline(knots: int) -> Shape:
    """Return a cubic spline through values at evenly spaced knots from `low` to `high`."""
    names = [f"v{i}" for i in range(knots)]

    def function(p: Mapping[str, float], x: FloatArray) -> FloatArray:
        curve = scipy.interpolate.make_interp_spline(
            np.linspace(p["low"], p["high"], knots), [p[name] for name in names], k=3
        )
        return np.asarray(curve(np.clip(x, p["low"], p["high"])), dtype=np.float64)

    return Shape(
        sizes=dict.fromkeys(names, 0),
        ends=("low", "high"),
        formula=f"a cubic spline over {{x}} through v0 … v{knots - 1}, evenly from low to high",
        function=function,
        sentence=lambda it: (
            f"The {it.what} follows a smooth curve over {it.along}: it varies by"
            f" {it.size(float(np.ptp([it.values[name] for name in names])))} in all."
        ),
    )


def _of_u(formula: str, of_u: Callable[[FloatArray], FloatArray]) -> Shape:
    """Return a shape of u = (x − at)/width for simulations; a diagnosis does not search for it."""
    return Shape(
        places=("at",),
        lengths=("width",),
        formula=formula,
        function=lambda p, x: p["change"] * of_u((x - p["at"]) / p["width"]),
        sentence=lambda it: (
            f"The {it.what} depends on {it.along} as {formula.format(x='x')}: change {it.change()}, at"
            f" {it.place()}, width {it.place('width')}."
        ),
    )


SHAPES: Mapping[str, Shape] = {
    "step": _step("above", 1.0, "({x} − at)"),
    "step_below": _step("below", -1.0, "(at − {x})"),
    "steps": Shape(
        sizes={"change": 0, "change_2": 0},
        places=("at", "at_2"),
        lengths=("width",),
        formula="change·clip(({x} − at)/width + ½, 0, 1) + change_2·clip(({x} − at_2)/width + ½, 0, 1)",
        function=lambda p, x: (
            p["change"] * _ramp(x, p["at"], p["width"]) + p["change_2"] * _ramp(x, p["at_2"], p["width"])
        ),
        sentence=lambda it: (
            f"Above {it.place()} of {it.along} the {it.what} is {it.change()}, and above {it.place('at_2')}"
            f" {it.change('change_2')} than before; each change takes {it.place('width')} or less."
        ),
    ),
    "jump": Shape(
        places=("at",),
        formula="change·[{x} ≥ at]",
        function=lambda p, x: p["change"] * (x >= p["at"]),
        sentence=lambda it: f"From {it.place()} of {it.along} on the {it.what} is {it.change()}.",
    ),
    "plateau": Shape(
        places=("at",),
        lengths=("length",),
        formula="change·[at ≤ {x} < at + length]",
        function=_plateau,
        sentence=lambda it: (
            f"Where {it.along} is between {it.place()} and {it.place(it.values['at'] + it.values['length'])}"
            f" the {it.what} is {it.change()}."
        ),
    ),
    "kink": _kink("above", "max"),
    "kink_below": _kink("below", "min"),
    "power": _power("above", 1.0, "high", "{x} − at"),
    "power_below": _power("below", -1.0, "low", "at − {x}"),
    "bend": Shape(
        sizes={"below": 1, "above": 1},
        places=("at",),
        formula="below·min({x} − at, 0) + above·max({x} − at, 0)",
        function=_two_slopes,
        sentence=lambda it: (
            f"The {it.what} bends at {it.place()} of {it.along}: below, it {it.slope('below')}; above, it"
            f" {it.slope('above')}."
        ),
    ),
    "bump": Shape(
        places=("at",),
        lengths=("width",),
        formula="change·exp(−½·(({x} − at)/width)²)",
        function=lambda p, x: p["change"] * np.exp(-0.5 * ((x - p["at"]) / p["width"]) ** 2),
        sentence=_peak,
    ),
    "wave": Shape(
        sizes={"cosine": 0, "sine": 0},
        lengths=("period",),
        formula="cosine·cos(2π·{x}/period) + sine·sin(2π·{x}/period)",
        function=_wave,
        sentence=_periodic,
    ),
    "line": _polynomial(1, "straight line"),
    "parabola": _polynomial(2, "parabola"),
    "cubic": _polynomial(3, "cubic"),
    "exponential": Shape(
        lengths=("tau",),
        formula="change·exp(−{x}/tau)",
        function=lambda p, x: p["change"] * np.exp(-x / p["tau"]),
        sentence=lambda it: (
            f"The {it.what} begins {it.change()} and settles over {it.along} with a constant of {it.place('tau')}."
        ),
    ),
    "rise": _exponential(1.0, "high", "change·exp(({x} − high)/tau)", "rises"),
    "fall": _exponential(-1.0, "low", "change·exp((low − {x})/tau)", "falls"),
    "bursts": Shape(
        places=("at",),
        lengths=("period", "length"),
        formula="change·[({x} − at) mod period < length]",
        function=_bursts,
        sentence=lambda it: (
            f"Every {it.place('period')} of {it.along}, from {it.place()} on, the {it.what} is {it.change()}"
            f" for {it.place('length')}."
        ),
    ),
    "negative": _by_sign(0, "<", lambda x: x < 0.0),
    "positive": _by_sign(1, ">", lambda x: x > 0.0),
    "either": _by_sign(2, "≠", lambda x: x != 0.0),
    "resonance": Shape(
        places=("at",),
        lengths=("width",),
        formula="change/(1 + (({x} − at)/width)²)",
        function=lambda p, x: p["change"] / (1.0 + ((x - p["at"]) / p["width"]) ** 2),
        sentence=_peak,
    ),
    "hysteresis": Shape(
        sizes={"c1": 1},
        lengths=("width",),
        formula="c1·(play({x}; ±width) − {x})",
        function=lambda p, x: p["c1"] * x,
        sentence=lambda it: (
            f"The {it.what} has a hysteresis over {it.along}: at the same value it differs by"
            f" {it.size(2.0 * it.values['width'] * it.values['c1'])} between rising and falling; it follows with"
            f" a backlash of ±{it.place('width')}."
        ),
        memory="backlash",
    ),
    **{f"spline{knots}": _spline(knots) for knots in (6, 12, 24)},
    "memory": Shape(
        sizes={"c1": 1},
        formula="c1·y, τ·dy/dt = {x} − y, τ = tau",
        function=lambda p, x: p["c1"] * x,
        sentence=lambda it: (
            f"The {it.what} follows {it.along} with a memory of {it.values['tau']:.4g} s: it"
            f" {it.slope('c1')} of what {it.along} was."
        ),
        memory="lag",
    ),
    "smooth_step": _of_u("change·(1 + tanh(({x} − at)/width))/2", lambda u: 0.5 * (1.0 + np.tanh(u))),
    "smooth_plateau": _of_u(
        "change·(tanh(4·({x} − at)/width + 4) − tanh(4·({x} − at)/width − 4))/2",
        lambda u: 0.5 * (np.tanh(4.0 * u + 4.0) - np.tanh(4.0 * u - 4.0)),
    ),
    "double_bump": _of_u(
        "change·(exp(−½·(({x} − at)/width)²) − 0.7·exp(−½·(({x} − at)/width − 4)²))",
        lambda u: np.exp(-0.5 * u**2) - 0.7 * np.exp(-0.5 * (u - 4.0) ** 2),
    ),
    "root": _of_u("change·√(max({x} − at, 0)/width)", lambda u: np.sqrt(np.maximum(u, 0.0))),
    "growth": _of_u("change·exp(({x} − at)/width)", np.exp),
    "curved": _of_u("change·((({x} − at)/width)³ − ({x} − at)/width)", lambda u: u**3 - u),
    "sawtooth": _of_u("change·(2·({x}/width mod 1) − 1)", lambda u: 2.0 * np.mod(u, 1.0) - 1.0),
    "rectified": _of_u("change·|sin(π·({x} − at)/width)|", lambda u: np.abs(np.sin(math.pi * u))),
    "chirp": _of_u("change·sin(2π·(u + u²/8)), u = ({x} − at)/width", lambda u: np.sin(math.tau * (u + 0.125 * u**2))),
}
