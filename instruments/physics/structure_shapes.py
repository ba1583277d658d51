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
_MANIFOLD = 2.0
"""Increase of a share above which it is stated as a factor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """The data for the sentence about a structure: its stage, its coordinate and its values."""

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
        """Return a change with its direction, in words; that of a share by a large factor as this factor."""
        value = self.values[name]
        if ACTS[self.stage].printed[1] == "%" and value > _MANIFOLD:
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
    """A shape: sizes with the power of the coordinate in their unit, places in x, lengths in x, and its function.

    `ends` are the ends of its range, which are not fitted; `numbers` are parameters without a unit, with their bounds.
    The callable `says` returns a sentence about it. With a `memory`, x is the coordinate after a first-order lag, or
    the part of it that a backlash holds back.
    """

    sizes: Mapping[str, int] = field(default_factory=lambda: {"change": 0})
    places: tuple[str, ...] = ()
    lengths: tuple[str, ...] = ()
    ends: tuple[Literal["low", "high"], ...] = ()
    numbers: Mapping[str, Span] = field(default_factory=dict)
    formula: str
    function: Callable[[Mapping[str, float], FloatArray], Any]
    says: Callable[[Said], str]
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


def _bent(p: Mapping[str, float], x: FloatArray) -> FloatArray:
    return p.get("below", 0.0) * np.minimum(x - p["at"], 0.0) + p.get("above", 0.0) * np.maximum(x - p["at"], 0.0)


def _waves(said: Said) -> str:
    size = said.size(math.hypot(said.values["cosine"], said.values["sine"]))
    return f"The {said.what} follows a wave over {said.along}: ±{size}, with a period of {said.place('period')}."


def _within(said: Said) -> str:
    return (
        f"About {said.place()} of {said.along} the {said.what} is up to {said.change()}, within {said.place('width')}"
        " to either side."
    )


def _step(side: str, sign: float, formula: str) -> Shape:
    """Return a step on one side of a place, as a ramp over a width."""
    return Shape(
        places=("at",),
        lengths=("width",),
        formula=f"change·clip({formula}/width + ½, 0, 1)",
        function=lambda p, x: p["change"] * _ramp(sign * x, sign * p["at"], p["width"]),
        says=lambda of: (
            f"Where {of.along} is {side} {of.place()} the {of.what} is {of.change()}; the change takes"
            f" {of.place('width')} or less."
        ),
    )


def _kink(side: str, limited: str) -> Shape:
    """Return a shape that is zero on one side of a place and linear on the other."""
    return Shape(
        sizes={side: 1},
        places=("at",),
        formula=f"{side}·{limited}({{x}} − at, 0)",
        function=_bent,
        says=lambda of: f"{side.capitalize()} {of.place()} of {of.along} the {of.what} {of.slope(side)}.",
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
        says=lambda of: (
            f"{side.capitalize()} {of.place()} of {of.along} the {of.what} changes as the distance to the power"
            f" of {of.values['exponent']:.3g}: at {of.place(end)} it is {of.change()}."
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
        says=lambda of: (
            f"The {of.what} changes exponentially as {of.along} {how}, by a factor e each {of.place('tau')}: at"
            f" {of.place(end)} it is {of.change()}."
        ),
    )


def _polynomial(degree: int, name: str) -> Shape:
    """Return a polynomial without a constant."""
    names = [f"c{i + 1}" for i in range(degree)]

    def says(said: Said) -> str:
        terms = ", ".join(f"{one} = {said.values[one]:.3g}" for one in names)
        return f"The {said.what} follows a {name} over {said.along}: {terms}."

    return Shape(
        sizes={one: i + 1 for i, one in enumerate(names)},
        formula=" + ".join(f"{one}·{{x}}{('', '²', '³')[i]}" for i, one in enumerate(names)),
        function=lambda p, x: np.polynomial.polynomial.polyval(x, [0.0, *(p[one] for one in names)]),
        says=says,
    )


def _way(number: int, relation: str, chosen: Callable[[FloatArray], BoolArray]) -> Shape:
    """Return a change where the coordinate is below zero, above zero, or not zero."""

    def says(said: Said) -> str:
        ways = OVER[said.over].ways
        where = f"Where {said.along} is {('below', 'above', 'not')[number]} zero"
        return f"{where if ways is None else f'While {ways[number]}'} the {said.what} is {said.change()}."

    return Shape(formula=f"change·[{{x}} {relation} 0]", function=lambda p, x: p["change"] * chosen(x), says=says)


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
        says=lambda of: (
            f"The {of.what} follows a smooth curve over {of.along}: it varies by"
            f" {of.size(float(np.ptp([of.values[name] for name in names])))} in all."
        ),
    )


def _any(formula: str, of_share: Callable[[FloatArray], FloatArray]) -> Shape:
    """Return a function of the distance from a place in units of a width; a diagnosis does not search for it."""
    return Shape(
        places=("at",),
        lengths=("width",),
        formula=formula,
        function=lambda p, x: p["change"] * of_share((x - p["at"]) / p["width"]),
        says=lambda of: (
            f"The {of.what} depends on {of.along} as {formula.format(x='x')}: change {of.change()}, at"
            f" {of.place()}, width {of.place('width')}."
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
        says=lambda of: (
            f"Above {of.place()} of {of.along} the {of.what} is {of.change()}, and above {of.place('at_2')}"
            f" {of.change('change_2')} than before; each change takes {of.place('width')} or less."
        ),
    ),
    "jump": Shape(
        places=("at",),
        formula="change·[{x} ≥ at]",
        function=lambda p, x: p["change"] * (x >= p["at"]),
        says=lambda of: f"From {of.place()} of {of.along} on the {of.what} is {of.change()}.",
    ),
    "plateau": Shape(
        places=("at",),
        lengths=("length",),
        formula="change·[at ≤ {x} < at + length]",
        function=_plateau,
        says=lambda of: (
            f"Where {of.along} is between {of.place()} and {of.place(of.values['at'] + of.values['length'])}"
            f" the {of.what} is {of.change()}."
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
        function=_bent,
        says=lambda of: (
            f"The {of.what} bends at {of.place()} of {of.along}: below, it {of.slope('below')}; above, it"
            f" {of.slope('above')}."
        ),
    ),
    "bump": Shape(
        places=("at",),
        lengths=("width",),
        formula="change·exp(−½·(({x} − at)/width)²)",
        function=lambda p, x: p["change"] * np.exp(-0.5 * ((x - p["at"]) / p["width"]) ** 2),
        says=_within,
    ),
    "wave": Shape(
        sizes={"cosine": 0, "sine": 0},
        lengths=("period",),
        formula="cosine·cos(2π·{x}/period) + sine·sin(2π·{x}/period)",
        function=_wave,
        says=_waves,
    ),
    "line": _polynomial(1, "straight line"),
    "parabola": _polynomial(2, "parabola"),
    "cubic": _polynomial(3, "cubic"),
    "exponential": Shape(
        lengths=("tau",),
        formula="change·exp(−{x}/tau)",
        function=lambda p, x: p["change"] * np.exp(-x / p["tau"]),
        says=lambda of: (
            f"The {of.what} begins {of.change()} and settles over {of.along} with a constant of {of.place('tau')}."
        ),
    ),
    "rise": _exponential(1.0, "high", "change·exp(({x} − high)/tau)", "rises"),
    "fall": _exponential(-1.0, "low", "change·exp((low − {x})/tau)", "falls"),
    "bursts": Shape(
        places=("at",),
        lengths=("period", "length"),
        formula="change·[({x} − at) mod period < length]",
        function=_bursts,
        says=lambda of: (
            f"Every {of.place('period')} of {of.along}, from {of.place()} on, the {of.what} is {of.change()}"
            f" for {of.place('length')}."
        ),
    ),
    "negative": _way(0, "<", lambda x: x < 0.0),
    "positive": _way(1, ">", lambda x: x > 0.0),
    "either": _way(2, "≠", lambda x: x != 0.0),
    "resonance": Shape(
        places=("at",),
        lengths=("width",),
        formula="change/(1 + (({x} − at)/width)²)",
        function=lambda p, x: p["change"] / (1.0 + ((x - p["at"]) / p["width"]) ** 2),
        says=_within,
    ),
    "hysteresis": Shape(
        sizes={"c1": 1},
        lengths=("width",),
        formula="c1·(play({x}; ±width) − {x})",
        function=lambda p, x: p["c1"] * x,
        says=lambda of: (
            f"The {of.what} has a hysteresis over {of.along}: at the same value it differs by"
            f" {of.size(2.0 * of.values['width'] * of.values['c1'])} between rising and falling; it follows with"
            f" a backlash of ±{of.place('width')}."
        ),
        memory="backlash",
    ),
    **{f"spline{knots}": _spline(knots) for knots in (6, 12, 24)},
    "memory": Shape(
        sizes={"c1": 1},
        formula="c1·y, τ·dy/dt = {x} − y, τ = tau",
        function=lambda p, x: p["c1"] * x,
        says=lambda of: (
            f"The {of.what} follows {of.along} with a memory of {of.values['tau']:.4g} s: it"
            f" {of.slope('c1')} of what {of.along} was."
        ),
        memory="lag",
    ),
    "smooth_step": _any("change·(1 + tanh(({x} − at)/width))/2", lambda u: 0.5 * (1.0 + np.tanh(u))),
    "smooth_plateau": _any(
        "change·(tanh(4·({x} − at)/width + 4) − tanh(4·({x} − at)/width − 4))/2",
        lambda u: 0.5 * (np.tanh(4.0 * u + 4.0) - np.tanh(4.0 * u - 4.0)),
    ),
    "double_bump": _any(
        "change·(exp(−½·(({x} − at)/width)²) − 0.7·exp(−½·(({x} − at)/width − 4)²))",
        lambda u: np.exp(-0.5 * u**2) - 0.7 * np.exp(-0.5 * (u - 4.0) ** 2),
    ),
    "root": _any("change·√(max({x} − at, 0)/width)", lambda u: np.sqrt(np.maximum(u, 0.0))),
    "growth": _any("change·exp(({x} − at)/width)", np.exp),
    "curved": _any("change·((({x} − at)/width)³ − ({x} − at)/width)", lambda u: u**3 - u),
    "sawtooth": _any("change·(2·({x}/width mod 1) − 1)", lambda u: 2.0 * np.mod(u, 1.0) - 1.0),
    "rectified": _any("change·|sin(π·({x} − at)/width)|", lambda u: np.abs(np.sin(math.pi * u))),
    "chirp": _any("change·sin(2π·(u + u²/8)), u = ({x} − at)/width", lambda u: np.sin(math.tau * (u + 0.125 * u**2))),
}
