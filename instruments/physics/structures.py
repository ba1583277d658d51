"""Physics without a name: what acts at a stage, as a function of a coordinate, in a shape that a search has found.

A structure is an effect like any other, made from a stage, a coordinate and a shape; its identifier says which:
`kink_of_scale_over_gyro_temp`. In a model file it is a table of `[discovered]`:

    [discovered.kink_of_scale_over_gyro_temp]
    at = 27.7
    above = -4.8e-4

Its function f acts on the scale factor as (U − U0)·(1 + f), on the bias as U + f.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, make_dataclass, replace
from functools import lru_cache
from typing import ClassVar, Literal

import numpy as np

from benchctl_instruments.interfaces import FloatArray
from benchctl_instruments.physics.chain import Signals
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect

StructureStage = Literal["scale", "bias"]
STAGES: tuple[StructureStage, ...] = ("scale", "bias")
SHAPES = (
    "step",
    "plateau",
    "kink",
    "kink_below",
    "bend",
    "bump",
    "wave",
    "line",
    "parabola",
    "cubic",
    "exponential",
)
Span = tuple[float, float]

_EVERYWHERE: Span = (-1e12, 1e12)
_UNITS: Mapping[str, str] = {
    "time": "s",
    "rate": "deg s-1",
    "abs_rate": "deg s-1",
    "rate_sign": "1",
    "acceleration": "deg s-2",
    "angle": "degree",
    "gyro_temp": "degC",
    "gyro_temp_rate": "degC s-1",
    "output": "V",
}
_VALUES: Mapping[str, Callable[[Signals], FloatArray]] = {
    "time": lambda signals: signals.time_s,
    "rate": lambda signals: signals.rate_dps,
    "abs_rate": lambda signals: np.abs(signals.rate_dps),
    "rate_sign": lambda signals: np.sign(signals.rate_dps),
    "acceleration": lambda signals: signals.acceleration_dps2,
    "angle": lambda signals: np.mod(signals.angle_deg, 360.0),
    "gyro_temp": lambda signals: signals.coil_c,
    "gyro_temp_rate": lambda signals: signals.coil_rate_c_per_s,
    "output": lambda signals: signals.output_v,
}
COORDINATES = tuple(_VALUES)
"""The words of coordinates that a structure may be a function of, each known to the chain."""

_LIMITS = {"scale": 2.0, "bias": 1e3}
_SIZE_SCAN = {"scale": 1e-6, "bias": 1e-6}
_NARROWEST, _WIDEST = 1e-3, 2.0
"""Widths and periods, as shares of the coordinate's range."""
_FROM = {
    "kink": ("above",),
    "kink_below": ("below",),
    "bend": ("below", "above"),
    "wave": ("cosine", "sine"),
    "line": ("c1",),
    "parabola": ("c1", "c2"),
    "cubic": ("c1", "c2", "c3"),
}
_NAME = re.compile(rf"({'|'.join(SHAPES)})_of_({'|'.join(STAGES)})_over_({'|'.join(COORDINATES)})")


class Structure(PhysicalEffect):
    """A structure; a subclass, made by `structure`, has the shape's parameters as its fields.

    Attributes
    ----------
    shape
        One of `SHAPES`.
    over
        The coordinate, one of `COORDINATES`.
    acts_on
        `scale` or `bias`.
    """

    shape: ClassVar[str]
    over: ClassVar[str]
    acts_on: ClassVar[StructureStage]
    pointwise: ClassVar[bool] = True

    def value_at(self, x: FloatArray) -> FloatArray:
        """Its function f at values of the coordinate, shape (n,)."""
        return _FUNCTIONS[self.shape](self.values, x)

    @property
    def is_sharp(self) -> bool:
        """Whether it is a step as narrow as one can be told, and at no other bound."""
        width = self.parameters.get("width")
        inside = all(one.low < self.values[name] < one.high for name, one in self.parameters.items() if name != "width")
        return self.shape == "step" and width is not None and self.values["width"] < width.high and inside

    def apply(self, signals: Signals) -> Signals:
        """The output with the structure."""
        change = self.value_at(_VALUES[self.over](signals))
        if self.acts_on == "scale":
            return replace(signals, output_v=signals.output_v * (1.0 + change))
        return replace(signals, output_v=signals.output_v + change)

    def says(self) -> str:
        """What it does, in one sentence with its numbers."""
        what = "scale factor" if self.acts_on == "scale" else "bias"
        return _SENTENCES[self.shape](_Said(effect=self, what=what))


@lru_cache(maxsize=512)
def structure(stage: StructureStage, over: str, shape: str, span: Span = _EVERYWHERE) -> type[Structure]:
    """The effect of a shape at a stage over a coordinate, of which a recording holds values in `span`."""
    parameters = _parameters(stage, over, shape, span)
    on = "U − U0 → (U − U0)·(1 + f)" if stage == "scale" else "U → U + f"
    namespace = {
        "identifier": f"{shape}_of_{stage}_over_{over}",
        "stage": stage,
        "acts_on": stage,
        "over": over,
        "shape": shape,
        "momentary": over in ("rate", "abs_rate", "rate_sign", "acceleration", "output"),
        "words": f"A structure without a name: the {'scale factor' if stage == 'scale' else 'bias'} depends on"
        f" {PHRASES[over]}.",
        "equation": f"{on}, f = {FORMULAS[shape].format(x=over)}",
        "coordinate": f"{over}*rate" if stage == "scale" else over,
        "excited_by": f"the range of {PHRASES[over]}",
        "look_alikes": (),
        "parameters": parameters,
        "__doc__": f"The {shape} of the {stage} over {over}.",
    }
    made = make_dataclass(
        "Discovered", [(name, float) for name in parameters], bases=(Structure,), frozen=True, kw_only=True
    )
    for name, value in namespace.items():
        setattr(made, name, value)
    return made


def structure_named(identifier: str) -> type[Structure] | None:
    """The structure of an identifier, over any range; None where it names none."""
    match = _NAME.fullmatch(identifier)
    if match is None:
        return None
    shape, stage, over = match.groups()
    return structure("scale" if stage == "scale" else "bias", over, shape)


PHRASES: Mapping[str, str] = {
    "time": "the time since the recording began",
    "rate": "the rate",
    "abs_rate": "the size of the rate",
    "rate_sign": "the direction of rotation",
    "acceleration": "the acceleration",
    "angle": "the table's angle",
    "gyro_temp": "the coil's temperature",
    "gyro_temp_rate": "the rate of the coil's temperature",
    "output": "the output",
}

FORMULAS: Mapping[str, str] = {
    "step": "change·clip(({x} − at)/width + ½, 0, 1)",
    "plateau": "change·[at ≤ {x} < at + length]",
    "kink": "above·max({x} − at, 0)",
    "kink_below": "below·min({x} − at, 0)",
    "bend": "below·min({x} − at, 0) + above·max({x} − at, 0)",
    "bump": "change·exp(−½·(({x} − at)/width)²)",
    "wave": "cosine·cos(2π·{x}/period) + sine·sin(2π·{x}/period)",
    "line": "c1·{x}",
    "parabola": "c1·{x} + c2·{x}²",
    "cubic": "c1·{x} + c2·{x}² + c3·{x}³",
    "exponential": "change·exp(−{x}/tau)",
}
"""The function of each shape of a coordinate `{x}`."""


def _ramp(x: FloatArray, at: float, width: float) -> FloatArray:
    return np.clip((x - at) / width + 0.5, 0.0, 1.0)


_EDGE = 0.01
"""The edges of a plateau, as a share of its length: a fit has to see where they are."""

_FUNCTIONS: Mapping[str, Callable[[Mapping[str, float], FloatArray], FloatArray]] = {
    "step": lambda p, x: p["change"] * _ramp(x, p["at"], p["width"]),
    "plateau": lambda p, x: (
        p["change"] * (_ramp(x, p["at"], _EDGE * p["length"]) - _ramp(x, p["at"] + p["length"], _EDGE * p["length"]))
    ),
    "kink": lambda p, x: p["above"] * np.maximum(x - p["at"], 0.0),
    "kink_below": lambda p, x: p["below"] * np.minimum(x - p["at"], 0.0),
    "bend": lambda p, x: p["below"] * np.minimum(x - p["at"], 0.0) + p["above"] * np.maximum(x - p["at"], 0.0),
    "bump": lambda p, x: p["change"] * np.exp(-0.5 * ((x - p["at"]) / p["width"]) ** 2),
    "wave": lambda p, x: (
        p["cosine"] * np.cos(math.tau / p["period"] * x) + p["sine"] * np.sin(math.tau / p["period"] * x)
    ),
    "line": lambda p, x: p["c1"] * x,
    "parabola": lambda p, x: (p["c2"] * x + p["c1"]) * x,
    "cubic": lambda p, x: ((p["c3"] * x + p["c2"]) * x + p["c1"]) * x,
    "exponential": lambda p, x: p["change"] * np.exp(-x / p["tau"]),
}


def _parameters(stage: StructureStage, over: str, shape: str, span: Span) -> Mapping[str, Parameter]:
    """Its parameters, sizes first; where they are known, within the range of the coordinate."""
    unit, along = ("1" if stage == "scale" else "V"), _UNITS[over]
    low, high = span
    wide = high - low
    powers = {"above": 1, "below": 1, "c1": 1, "c2": 2, "c3": 3}
    reach = max(abs(low), abs(high), wide) if span != _EVERYWHERE else 1.0
    made: dict[str, Parameter] = {}
    for name in _FROM.get(shape, ("change",)):
        power = powers.get(name, 0)
        limit = _LIMITS[stage] / (reach**power if span != _EVERYWHERE else 1e-12)
        per = f" ({along})-{power}" if power else ""
        made[name] = Parameter(
            unit=f"{unit}{per}",
            meaning="what it changes" if not power else "change a unit of the coordinate",
            low=-limit,
            high=limit,
            role="size",
            scan=(_SIZE_SCAN[stage] / reach**power,),
            zero=0.0,
        )
    if shape in ("step", "plateau", "kink", "kink_below", "bend", "bump"):
        made["at"] = Parameter(
            unit=along, meaning="where it is", low=low, high=high, role="shape", scan=(low, high), nudge=1e-4
        )
    lengths = {"step": "width", "bump": "width", "plateau": "length", "wave": "period", "exponential": "tau"}
    if shape in lengths:
        bounded = span != _EVERYWHERE
        least, most = (_NARROWEST * wide, _WIDEST * wide) if bounded else (1e-12, 1e12)
        made[lengths[shape]] = Parameter(
            unit=along,
            meaning={"width": "how wide it is", "length": "how long it is"}.get(lengths[shape], "its length in x"),
            low=least,
            high=most,
            role="shape",
            scan=(least, most),
            logarithmic=True,
        )
    return made


@dataclass(frozen=True, slots=True, kw_only=True)
class _Said:
    """What the sentences about a structure are made of."""

    effect: Structure
    what: str

    @property
    def over(self) -> str:
        return PHRASES[self.effect.over]

    def size(self, value: float) -> str:
        if self.effect.acts_on == "scale":
            return f"{100.0 * abs(value):.3g} %"
        return f"{1e3 * abs(value):.3g} mV"

    def way(self, value: float) -> str:
        return "lower" if value < 0.0 else "higher"

    def place(self, name: str = "at") -> str:
        return f"{self.effect.values[name]:.4g} {_PRINTED.get(self.effect.over, '')}".rstrip()

    def slope(self, name: str) -> str:
        value = self.effect.values[name]
        return f"{'falls' if value < 0.0 else 'rises'} by {self.size(value)} per {_PRINTED.get(self.effect.over, '1')}"


_PRINTED: Mapping[str, str] = {
    "time": "s",
    "rate": "°/s",
    "abs_rate": "°/s",
    "acceleration": "°/s²",
    "angle": "°",
    "gyro_temp": "°C",
    "gyro_temp_rate": "°C/s",
    "output": "V",
}


def _step(said: _Said) -> str:
    change = said.effect.values["change"]
    return (
        f"Where {said.over} is above {said.place()} the {said.what} is {said.size(change)} {said.way(change)}; the"
        f" change takes {said.place('width')} or less."
    )


def _plateau(said: _Said) -> str:
    values = said.effect.values
    until = f"{values['at'] + values['length']:.4g} {_PRINTED.get(said.effect.over, '')}".rstrip()
    return (
        f"Where {said.over} is between {said.place()} and {until} the {said.what} is {said.size(values['change'])}"
        f" {said.way(values['change'])}."
    )


def _bump(said: _Said) -> str:
    change = said.effect.values["change"]
    return (
        f"About {said.place()} of {said.over} the {said.what} is up to {said.size(change)} {said.way(change)}, within"
        f" {said.place('width')} to either side."
    )


def _wave(said: _Said) -> str:
    values = said.effect.values
    size = math.hypot(values["cosine"], values["sine"])
    return (
        f"The {said.what} follows a wave over {said.over}: ±{said.size(size)}, with a period of {said.place('period')}."
    )


def _curve(said: _Said) -> str:
    terms = [f"{name} = {value:.3g}" for name, value in said.effect.values.items()]
    degree = {1: "straight line", 2: "parabola", 3: "cubic"}[len(terms)]
    return f"The {said.what} follows a {degree} over {said.over}: {', '.join(terms)}."


def _exponential(said: _Said) -> str:
    change = said.effect.values["change"]
    return (
        f"The {said.what} begins {said.size(change)} {said.way(change)} and settles over {said.over} with a constant of"
        f" {said.place('tau')}."
    )


_SENTENCES: Mapping[str, Callable[[_Said], str]] = {
    "step": _step,
    "plateau": _plateau,
    "kink": lambda said: f"Above {said.place()} of {said.over} the {said.what} {said.slope('above')}.",
    "kink_below": lambda said: f"Below {said.place()} of {said.over} the {said.what} {said.slope('below')}.",
    "bend": lambda said: (
        f"The {said.what} bends at {said.place()} of {said.over}: below, it {said.slope('below')}; above, it"
        f" {said.slope('above')}."
    ),
    "bump": _bump,
    "wave": _wave,
    "line": _curve,
    "parabola": _curve,
    "cubic": _curve,
    "exponential": _exponential,
}
