"""Physics without a name: what acts at a stage, as a function of a coordinate, in a shape that a search has found.

A structure is an effect like any other, made from a stage, a coordinate and a shape; its identifier says which:
`kink_of_scale_over_gyro_temp`. In a model file it is a table of `[discovered]`, a second of its kind with `_2` behind
its name:

    [discovered.kink_of_scale_over_gyro_temp]
    at = 27.7
    above = -4.8e-4

Its function f acts on the scale factor as (U − U0)·(1 + f), on the bias as U + f, on the sampling as a delay f, on the
encoder's angle as θ + f, on the noise as σ·(1 + f).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, make_dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar, Literal

import numpy as np
import scipy  # which loads interpolate and signal when they are first used

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.draws import normals
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect, Role

StructureStage = Literal["scale", "bias", "sampling", "encoder", "noise"]
Span = tuple[float, float]

SETPOINT_WAY = "setpoint_way"
"""Auxiliary signal: −1 while the chamber's set point falls, 1 while it rises, 0 while it stands."""
CHAMBER_C = "chamber_temp_c"
"""Auxiliary signal: the chamber's air."""
_EVERYWHERE: Span = (-1e12, 1e12)
_ARCSEC = 3600.0
_LEAST_TURNING_DPS = 0.5
_NARROWEST, _WIDEST = 1e-3, 2.0
"""Widths and periods, as shares of the coordinate's range."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Acts:
    """A stage: where in the chain it is, what it changes, in which unit, and how that is printed."""

    chain: Stage
    what: str
    unit: str
    limit: float
    printed: tuple[float, str]
    equation: str
    formula: str


ACTS: Mapping[StructureStage, _Acts] = {
    "scale": _Acts(
        chain="scale",
        what="scale factor",
        unit="1",
        limit=2.0,
        printed=(100.0, "%"),
        equation="U − U0 → (U − U0)·(1 + f)",
        formula="K = K0·(1 + {f})",
    ),
    "bias": _Acts(
        chain="bias",
        what="bias",
        unit="V",
        limit=1e3,
        printed=(1e3, "mV"),
        equation="U → U + f",
        formula="U = U0 + {f}",
    ),
    "sampling": _Acts(
        chain="sensed_rate",
        what="delay of the gyro",
        unit="s",
        limit=0.1,
        printed=(1e3, "ms"),
        equation="ω(t) → ω(t − f)",
        formula="ω(t − {f})",
    ),
    "encoder": _Acts(
        chain="sampling",
        what="angle that the encoder states",
        unit="arcsec",
        limit=1e5,
        printed=(1.0, "″"),
        equation="θ → θ + f",
        formula="θ + {f}",
    ),
    "noise": _Acts(
        chain="sampling",
        what="noise",
        unit="1",
        limit=1e2,
        printed=(100.0, "%"),
        equation="σ → σ·(1 + f)",
        formula="σ·(1 + {f})",
    ),
}
STAGES: tuple[StructureStage, ...] = tuple(ACTS)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Over:
    """A coordinate: its word in a diagnosis, its unit, how it is written, and its values of signals.

    `momentary` ones follow the motion. Of `signed` ones zero is where nothing is changed. `ways` are said of
    coordinates that have the values −1, 0 and 1 only: below, above and away from zero.
    """

    word: str
    unit: str
    printed: str
    phrase: str
    values: Callable[[Signals], FloatArray]
    momentary: bool = False
    signed: bool = False
    ways: tuple[str, str, str] | None = None


def _auxiliary(name: str) -> Callable[[Signals], FloatArray]:
    return lambda signals: signals.auxiliary.get(name, np.zeros_like(signals.time_s))


def last_sign(rate_dps: FloatArray, before: float = 0.0) -> FloatArray:
    """The direction in which the table turned last, −1, 0 or 1, shape (n,); `before` is that before the first row."""
    turning = np.abs(rate_dps) > _LEAST_TURNING_DPS
    place = np.maximum.accumulate(np.where(turning, np.arange(rate_dps.size), -1))
    return np.where(place >= 0, np.sign(rate_dps[np.maximum(place, 0)]), before)


OVER: Mapping[str, _Over] = {
    "time": _Over(
        word="time",
        unit="s",
        printed="s",
        phrase="the time since the recording began",
        values=lambda signals: signals.time_s,
    ),
    "rate": _Over(
        word="rate",
        unit="deg s-1",
        printed="°/s",
        phrase="the rate",
        values=lambda signals: signals.rate_dps,
        momentary=True,
        signed=True,
    ),
    "abs_rate": _Over(
        word="abs_rate",
        unit="deg s-1",
        printed="°/s",
        phrase="the size of the rate",
        values=lambda signals: np.abs(signals.rate_dps),
        momentary=True,
    ),
    "rate_sign": _Over(
        word="rate_sign",
        unit="1",
        printed="",
        phrase="the direction of rotation",
        values=lambda signals: np.where(np.abs(signals.rate_dps) < _LEAST_TURNING_DPS, 0.0, np.sign(signals.rate_dps)),
        momentary=True,
        signed=True,
        ways=("the table turns clockwise", "the table turns counter-clockwise", "the table turns"),
    ),
    "last_sign": _Over(
        word="rate_sign",
        unit="1",
        printed="",
        phrase="the direction in which the table turned last",
        values=lambda signals: last_sign(signals.rate_dps),
        momentary=True,
        signed=True,
        ways=("the last turn was clockwise", "the last turn was counter-clockwise", "the table has turned"),
    ),
    "acceleration": _Over(
        word="acceleration",
        unit="deg s-2",
        printed="°/s²",
        phrase="the acceleration",
        values=lambda signals: signals.acceleration_dps2,
        momentary=True,
        signed=True,
    ),
    "angle": _Over(
        word="angle",
        unit="degree",
        printed="°",
        phrase="the table's angle",
        values=lambda signals: np.mod(signals.angle_deg, 360.0),
    ),
    "gyro_temp": _Over(
        word="gyro_temp",
        unit="degC",
        printed="°C",
        phrase="the coil's temperature",
        values=lambda signals: signals.coil_c,
    ),
    "gyro_temp_rate": _Over(
        word="gyro_temp_rate",
        unit="degC s-1",
        printed="°C/s",
        phrase="the rate of the coil's temperature",
        values=lambda signals: signals.coil_rate_c_per_s,
        signed=True,
    ),
    "chamber_temp": _Over(
        word="chamber_temp",
        unit="degC",
        printed="°C",
        phrase="the chamber's temperature",
        values=_auxiliary(CHAMBER_C),
    ),
    "setpoint": _Over(
        word="setpoint",
        unit="1",
        printed="",
        phrase="the way in which the chamber's set point moves",
        values=_auxiliary(SETPOINT_WAY),
        signed=True,
        ways=("the chamber's set point falls", "the chamber's set point rises", "the chamber's set point moves"),
    ),
    "output": _Over(
        word="output",
        unit="V",
        printed="V",
        phrase="the output",
        values=lambda signals: signals.output_v,
        momentary=True,
        signed=True,
    ),
}
COORDINATES = tuple(OVER)
"""Coordinates that a structure may be a function of, each known to the chain."""


def _ramp(x: FloatArray, at: float, width: float) -> FloatArray:
    return np.clip((x - at) / width + 0.5, 0.0, 1.0)


_EDGE = 0.01
"""The edges of a plateau, as a share of its length: a fit has to see where they are."""


def _plateau(p: Mapping[str, float], x: FloatArray) -> FloatArray:
    edge = _EDGE * p["length"]
    return p["change"] * (_ramp(x, p["at"], edge) - _ramp(x, p["at"] + p["length"], edge))


def _bursts(p: Mapping[str, float], x: FloatArray) -> FloatArray:
    since = np.mod(x - p["at"], p["period"])
    edge = _EDGE * p["length"]
    # the edge of the next burst begins before it
    return p["change"] * (_ramp(since, 0.0, edge) - _ramp(since, p["length"], edge) + _ramp(since, p["period"], edge))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shape:
    """A shape: sizes with the power of the coordinate that each goes with, places in x, lengths in x, its function.

    `ends` are places that no fit moves.

    `says` is a sentence about it; `memory` says that x is the coordinate through a first-order lag.
    """

    sizes: Mapping[str, int] = field(default_factory=lambda: {"change": 0})
    places: tuple[str, ...] = ()
    lengths: tuple[str, ...] = ()
    ends: tuple[str, ...] = ()
    formula: str
    function: Callable[[Mapping[str, float], FloatArray], Any]
    says: Callable[[_Said], str]
    memory: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class _Said:
    """What the sentences about a structure are made of."""

    effect: Structure

    @property
    def what(self) -> str:
        return ACTS[self.effect.acts_on].what

    @property
    def over(self) -> str:
        return OVER[self.effect.over].phrase

    def size(self, value: float) -> str:
        factor, unit = ACTS[self.effect.acts_on].printed
        return f"{factor * abs(value):.3g} {unit}"

    def change(self, name: str = "change") -> str:
        value = self.effect.values[name]
        return f"{self.size(value)} {'lower' if value < 0.0 else 'higher'}"

    def place(self, value: str | float = "at") -> str:
        number = self.effect.values[value] if isinstance(value, str) else value
        return f"{number:.4g} {OVER[self.effect.over].printed}".rstrip()

    def slope(self, name: str) -> str:
        value = self.effect.values[name]
        return (
            f"{'falls' if value < 0.0 else 'rises'} by {self.size(value)} per {OVER[self.effect.over].printed or '1'}"
        )

    def way(self, number: int) -> str:
        ways = OVER[self.effect.over].ways
        if ways is not None:
            return f"While {ways[number]}"
        return f"Where {self.over} is {('below zero', 'above zero', 'not zero')[number]}"

    def curve(self) -> str:
        terms = ", ".join(f"{name} = {value:.3g}" for name, value in self.effect.values.items())
        degree = {1: "straight line", 2: "parabola", 3: "cubic"}[len(self.effect.values)]
        return f"The {self.what} follows a {degree} over {self.over}: {terms}."

    def wave(self) -> str:
        size = math.hypot(self.effect.values["cosine"], self.effect.values["sine"])
        return (
            f"The {self.what} follows a wave over {self.over}: ±{self.size(size)}, with a period of"
            f" {self.place('period')}."
        )

    def until(self) -> str:
        return self.place(self.effect.values["at"] + self.effect.values["length"])


def _spline(knots: int) -> _Shape:
    """A smooth curve through values at evenly spaced knots from `low` to `high`."""
    names = [f"v{i}" for i in range(knots)]

    def function(p: Mapping[str, float], x: FloatArray) -> FloatArray:
        curve = scipy.interpolate.make_interp_spline(
            np.linspace(p["low"], p["high"], knots), [p[name] for name in names], k=3
        )
        return np.asarray(curve(np.clip(x, p["low"], p["high"])), dtype=np.float64)

    return _Shape(
        sizes=dict.fromkeys(names, 0),
        ends=("low", "high"),
        formula=f"a cubic spline over {{x}} through v0 … v{knots - 1}, evenly from low to high",
        function=function,
        says=lambda said: (
            f"The {said.what} follows a smooth curve over {said.over}: it varies by"
            f" {said.size(float(np.ptp([said.effect.values[name] for name in names])))} in all."
        ),
    )


_SHAPES: Mapping[str, _Shape] = {
    "step": _Shape(
        places=("at",),
        lengths=("width",),
        formula="change·clip(({x} − at)/width + ½, 0, 1)",
        function=lambda p, x: p["change"] * _ramp(x, p["at"], p["width"]),
        says=lambda said: (
            f"Where {said.over} is above {said.place()} the {said.what} is {said.change()}; the change takes"
            f" {said.place('width')} or less."
        ),
    ),
    "step_below": _Shape(
        places=("at",),
        lengths=("width",),
        formula="change·clip((at − {x})/width + ½, 0, 1)",
        function=lambda p, x: p["change"] * _ramp(-x, -p["at"], p["width"]),
        says=lambda said: (
            f"Where {said.over} is below {said.place()} the {said.what} is {said.change()}; the change takes"
            f" {said.place('width')} or less."
        ),
    ),
    "steps": _Shape(
        sizes={"change": 0, "change_2": 0},
        places=("at", "at_2"),
        lengths=("width",),
        formula="change·clip(({x} − at)/width + ½, 0, 1) + change_2·clip(({x} − at_2)/width + ½, 0, 1)",
        function=lambda p, x: (
            p["change"] * _ramp(x, p["at"], p["width"]) + p["change_2"] * _ramp(x, p["at_2"], p["width"])
        ),
        says=lambda said: (
            f"Above {said.place()} of {said.over} the {said.what} is {said.change()}, and above {said.place('at_2')}"
            f" {said.change('change_2')} than before; each change takes {said.place('width')} or less."
        ),
    ),
    "jump": _Shape(
        places=("at",),
        formula="change·[{x} ≥ at]",
        function=lambda p, x: p["change"] * (x >= p["at"]),
        says=lambda said: f"From {said.place()} of {said.over} on the {said.what} is {said.change()}.",
    ),
    "plateau": _Shape(
        places=("at",),
        lengths=("length",),
        formula="change·[at ≤ {x} < at + length]",
        function=_plateau,
        says=lambda said: (
            f"Where {said.over} is between {said.place()} and {said.until()} the {said.what} is {said.change()}."
        ),
    ),
    "kink": _Shape(
        sizes={"above": 1},
        places=("at",),
        formula="above·max({x} − at, 0)",
        function=lambda p, x: p["above"] * np.maximum(x - p["at"], 0.0),
        says=lambda said: f"Above {said.place()} of {said.over} the {said.what} {said.slope('above')}.",
    ),
    "kink_below": _Shape(
        sizes={"below": 1},
        places=("at",),
        formula="below·min({x} − at, 0)",
        function=lambda p, x: p["below"] * np.minimum(x - p["at"], 0.0),
        says=lambda said: f"Below {said.place()} of {said.over} the {said.what} {said.slope('below')}.",
    ),
    "bend": _Shape(
        sizes={"below": 1, "above": 1},
        places=("at",),
        formula="below·min({x} − at, 0) + above·max({x} − at, 0)",
        function=lambda p, x: p["below"] * np.minimum(x - p["at"], 0.0) + p["above"] * np.maximum(x - p["at"], 0.0),
        says=lambda said: (
            f"The {said.what} bends at {said.place()} of {said.over}: below, it {said.slope('below')}; above, it"
            f" {said.slope('above')}."
        ),
    ),
    "bump": _Shape(
        places=("at",),
        lengths=("width",),
        formula="change·exp(−½·(({x} − at)/width)²)",
        function=lambda p, x: p["change"] * np.exp(-0.5 * ((x - p["at"]) / p["width"]) ** 2),
        says=lambda said: (
            f"About {said.place()} of {said.over} the {said.what} is up to {said.change()}, within"
            f" {said.place('width')} to either side."
        ),
    ),
    "wave": _Shape(
        sizes={"cosine": 0, "sine": 0},
        lengths=("period",),
        formula="cosine·cos(2π·{x}/period) + sine·sin(2π·{x}/period)",
        function=lambda p, x: (
            p["cosine"] * np.cos(math.tau / p["period"] * x) + p["sine"] * np.sin(math.tau / p["period"] * x)
        ),
        says=_Said.wave,
    ),
    "line": _Shape(sizes={"c1": 1}, formula="c1·{x}", function=lambda p, x: p["c1"] * x, says=_Said.curve),
    "parabola": _Shape(
        sizes={"c1": 1, "c2": 2},
        formula="c1·{x} + c2·{x}²",
        function=lambda p, x: (p["c2"] * x + p["c1"]) * x,
        says=_Said.curve,
    ),
    "cubic": _Shape(
        sizes={"c1": 1, "c2": 2, "c3": 3},
        formula="c1·{x} + c2·{x}² + c3·{x}³",
        function=lambda p, x: ((p["c3"] * x + p["c2"]) * x + p["c1"]) * x,
        says=_Said.curve,
    ),
    "exponential": _Shape(
        lengths=("tau",),
        formula="change·exp(−{x}/tau)",
        function=lambda p, x: p["change"] * np.exp(-x / p["tau"]),
        says=lambda said: (
            f"The {said.what} begins {said.change()} and settles over {said.over} with a constant of"
            f" {said.place('tau')}."
        ),
    ),
    "bursts": _Shape(
        places=("at",),
        lengths=("period", "length"),
        formula="change·[({x} − at) mod period < length]",
        function=_bursts,
        says=lambda said: (
            f"Every {said.place('period')} of {said.over}, from {said.place()} on, the {said.what} is {said.change()}"
            f" for {said.place('length')}."
        ),
    ),
    "negative": _Shape(
        formula="change·[{x} < 0]",
        function=lambda p, x: p["change"] * (x < 0.0),
        says=lambda said: f"{said.way(0)} the {said.what} is {said.change()}.",
    ),
    "positive": _Shape(
        formula="change·[{x} > 0]",
        function=lambda p, x: p["change"] * (x > 0.0),
        says=lambda said: f"{said.way(1)} the {said.what} is {said.change()}.",
    ),
    "either": _Shape(
        formula="change·[{x} ≠ 0]",
        function=lambda p, x: p["change"] * (x != 0.0),
        says=lambda said: f"{said.way(2)} the {said.what} is {said.change()}.",
    ),
    "smooth_step": _Shape(
        places=("at",),
        lengths=("width",),
        formula="change·(1 + tanh(({x} − at)/width))/2",
        function=lambda p, x: p["change"] * 0.5 * (1.0 + np.tanh((x - p["at"]) / p["width"])),
        says=lambda said: (
            f"About {said.place()} of {said.over} the {said.what} becomes {said.change()}, within"
            f" {said.place('width')} to either side."
        ),
    ),
    "resonance": _Shape(
        places=("at",),
        lengths=("width",),
        formula="change/(1 + (({x} − at)/width)²)",
        function=lambda p, x: p["change"] / (1.0 + ((x - p["at"]) / p["width"]) ** 2),
        says=lambda said: (
            f"About {said.place()} of {said.over} the {said.what} is up to {said.change()}, half of it at"
            f" {said.place('width')} to either side."
        ),
    ),
    "sawtooth": _Shape(
        lengths=("period",),
        formula="change·(2·({x}/period mod 1) − 1)",
        function=lambda p, x: p["change"] * (2.0 * np.mod(x / p["period"], 1.0) - 1.0),
        says=lambda said: (
            f"The {said.what} follows a sawtooth over {said.over}: up to {said.change()}, with a period of"
            f" {said.place('period')}."
        ),
    ),
    "root": _Shape(
        places=("at",),
        lengths=("width",),
        formula="change·√(max({x} − at, 0)/width)",
        function=lambda p, x: p["change"] * np.sqrt(np.maximum(x - p["at"], 0.0) / p["width"]),
        says=lambda said: (
            f"Above {said.place()} of {said.over} the {said.what} is {said.change()} {said.place('width')} further on,"
            " and changes as the root of the distance."
        ),
    ),
    **{f"spline{knots}": _spline(knots) for knots in (6, 12)},
    "memory": _Shape(
        sizes={"c1": 1},
        formula="c1·y, τ·dy/dt = {x} − y, τ = tau",
        function=lambda p, x: p["c1"] * x,
        says=lambda said: (
            f"The {said.what} follows {said.over} with a memory of {said.effect.values['tau']:.4g} s: it"
            f" {said.slope('c1')} of what {said.over} was."
        ),
        memory=True,
    ),
}
SHAPES = tuple(_SHAPES)
FORMULAS: Mapping[str, str] = {name: one.formula for name, one in _SHAPES.items()}
"""The function of each shape of a coordinate `{x}`."""

_LOOK_ALIKES: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("bias", "rate"): ("rate_nonlinearity", "saturation", "two_rails", "dead_zone", "fringe_ambiguity"),
    ("bias", "abs_rate"): ("scale_asymmetry", "rate_squared"),
    ("bias", "rate_sign"): ("dead_zone", "scale_asymmetry"),
    ("bias", "acceleration"): ("timing_offset", "angular_acceleration", "sensor_bandwidth", "mount_resonance"),
    ("bias", "angle"): ("heading_dependent_bias",),
    ("bias", "gyro_temp"): ("bias_temperature",),
    ("bias", "gyro_temp_rate"): ("bias_temperature_rate", "thermal_lag"),
    ("bias", "time"): ("warm_up", "bias_drift"),
    ("bias", "output"): ("adc_nonlinearity",),
    ("scale", "gyro_temp"): ("scale_temperature", "scale_rate_temperature_coupling"),
    ("scale", "gyro_temp_rate"): ("thermal_lag", "thermal_hysteresis"),
    ("scale", "time"): ("scale_ageing", "scale_warm_up"),
    ("scale", "angle"): ("encoder_eccentricity", "encoder_interpolation"),
    ("sampling", "time"): ("clock_drift",),
}
"""Effects with a name that may do what a structure at a stage over a coordinate does."""
_NAME = re.compile(rf"({'|'.join(SHAPES)})_of_({'|'.join(STAGES)})_over_({'|'.join(COORDINATES)})(?:_[2-9])?")


class Structure(PhysicalEffect):
    """A structure; a subclass, made by `structure`, has the shape's parameters as its fields.

    Attributes
    ----------
    shape
        One of `SHAPES`.
    over
        The coordinate, one of `COORDINATES`.
    acts_on
        One of `STAGES`.
    """

    shape: ClassVar[str]
    over: ClassVar[str]
    acts_on: ClassVar[StructureStage]

    def value_at(self, x: FloatArray) -> FloatArray:
        """Its function f at values of the coordinate, shape (n,)."""
        return np.asarray(_SHAPES[self.shape].function(self.values, x), dtype=np.float64)

    def function_of(self, signals: Signals) -> tuple[FloatArray, Signals]:
        """Its function f of signals, shape (n,), and the signals with what it must remember of them."""
        x = OVER[self.over].values(signals)
        if self.pointwise:
            return self.value_at(x), signals
        kept = signals.memory.get(self.identifier)
        if self.over == "last_sign":
            x = last_sign(signals.rate_dps, 0.0 if kept is None else float(kept[0]))
            carried = np.array([x[-1]])
        if self.shape == "memory":
            x, carried = _lagged(x, signals, self.values["tau"], kept)
        return self.value_at(x), replace(signals, memory={**signals.memory, self.identifier: carried})

    @property
    def is_smooth(self) -> bool:
        """Whether it is a curve that follows anything smooth."""
        return bool(_SHAPES[self.shape].ends)

    @property
    def is_stepped(self) -> bool:
        """Whether it changes at places, over a width."""
        return self.shape in ("step", "step_below", "steps")

    @property
    def is_sharp(self) -> bool:
        """Whether it is a step as narrow as one can be told, and at no other bound."""
        width = self.parameters.get("width")
        inside = all(one.low < self.values[name] < one.high for name, one in self.parameters.items() if name != "width")
        return self.is_stepped and width is not None and self.values["width"] < width.high and inside

    def apply(self, signals: Signals) -> Signals:
        """The signals with the structure."""
        change, signals = self.function_of(signals)
        if self.acts_on == "scale":
            return replace(signals, output_v=signals.output_v * (1.0 + change))
        if self.acts_on == "sampling":
            return replace(signals, sensed_rate_dps=signals.sensed_rate_dps - change * signals.acceleration_dps2)
        if self.acts_on == "encoder":
            return replace(signals, encoder_deg=signals.encoder_deg + change / _ARCSEC)
        if self.acts_on == "noise":
            return replace(signals, output_v=signals.output_v + self._more_noise(signals, change))
        return replace(signals, output_v=signals.output_v + change)

    def _more_noise(self, signals: Signals, change: FloatArray) -> FloatArray:
        """What is missing to noise of σ·(1 + f), f ≥ 0, where noise of σ is there already."""
        drawn = normals(getattr(self, "seed", 1), self.identifier, signals.first_index, signals.time_s.size, 1)[:, 0]
        more = np.sqrt(np.maximum((1.0 + change) ** 2 - 1.0, 0.0))
        return np.asarray(drawn * more * getattr(self, "noise_v_rms", 0.0))

    def says(self) -> str:
        """What it does, in one sentence with its numbers."""
        return _SHAPES[self.shape].says(_Said(effect=self))


def _lagged(x: FloatArray, signals: Signals, tau_s: float, kept: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """The first-order lag of x, which goes on from what was `kept`, and what is to be kept of it."""
    share = -math.expm1(-signals.interval_s / tau_s)
    value = float(x[0])
    if kept is not None:
        value += (float(kept[1]) - value) * math.exp(-max(float(signals.time_s[0]) - float(kept[0]), 0.0) / tau_s)
    y, _ = scipy.signal.lfilter([share], [1.0, share - 1.0], x, zi=[(1.0 - share) * value])
    return y, np.array([signals.time_s[-1] + signals.interval_s, y[-1]])


@lru_cache(maxsize=1024)
def structure(stage: StructureStage, over: str, shape: str, span: Span = _EVERYWHERE) -> type[Structure]:
    """The effect of a shape at a stage over a coordinate, of which a recording holds values in `span`."""
    acts, coordinate = ACTS[stage], OVER[over]
    parameters = _parameters(stage, over, shape, span)
    remembers = _SHAPES[shape].memory or over == "last_sign"
    namespace = {
        "identifier": f"{shape}_of_{stage}_over_{over}",
        "stage": acts.chain,
        "acts_on": stage,
        "over": over,
        "shape": shape,
        "pointwise": not remembers,
        "several": not remembers and stage != "noise",
        "timeless": remembers and not _SHAPES[shape].memory,
        "momentary": coordinate.momentary or stage == "sampling",
        "words": f"A structure without a name: the {acts.what} depends on {coordinate.phrase}.",
        "equation": f"{acts.equation}, f = {FORMULAS[shape].format(x=over)}",
        "coordinate": f"{coordinate.word}*rate" if stage == "scale" and coordinate.word != "rate" else coordinate.word,
        "excited_by": f"the range of {coordinate.phrase}",
        "look_alikes": _LOOK_ALIKES.get((stage, coordinate.word), ()),
        "parameters": parameters,
        "__doc__": f"The {shape} of the {stage} over {over}.",
    }
    fields: list[tuple[str, type] | tuple[str, type, object]] = [(name, float) for name in parameters]
    if stage == "noise":
        fields += [("noise_v_rms", float, field(default=5e-4)), ("seed", int, field(default=1))]
    made = make_dataclass("Discovered", fields, bases=(Structure,), frozen=True, kw_only=True)
    for name, value in namespace.items():
        setattr(made, name, value)
    return made


def unmoved(effect: Structure, roles: tuple[Role, ...] = ("size", "shape")) -> Structure:
    """The same structure with numbers that no fit moves: those of some roles."""
    kind = type(effect)
    parameters = {
        name: replace(parameter, role="assumed") if parameter.role in roles else parameter
        for name, parameter in kind.parameters.items()
    }
    held: type[Structure] = type(kind.__name__, (kind,), {"parameters": parameters, "__doc__": kind.__doc__})
    return held.make(effect.values)


def structure_named(identifier: str) -> type[Structure] | None:
    """The structure of an identifier, or of one with a number behind it, over any range; None where it names none."""
    match = _NAME.fullmatch(identifier)
    if match is None:
        return None
    shape, stage, over = match.groups()
    return structure(next(one for one in STAGES if one == stage), over, shape)


def _parameters(stage: StructureStage, over: str, shape: str, span: Span) -> Mapping[str, Parameter]:
    """Its parameters, sizes first; where they are known, within the range of the coordinate."""
    acts, along, form = ACTS[stage], OVER[over].unit, _SHAPES[shape]
    low, high = span
    wide, bounded = high - low, span != _EVERYWHERE
    reach = max(abs(low), abs(high), wide) if bounded else 1.0
    made: dict[str, Parameter] = {}
    for name, power in form.sizes.items():
        limit = acts.limit / (reach**power if bounded or not power else 1e-12)
        per = f" ({along})-{power}" if power else ""
        made[name] = Parameter(
            unit=f"{acts.unit}{per}",
            meaning="what it changes" if not power else "change a unit of the coordinate",
            low=-limit,
            high=limit,
            role="size",
            scan=(1e-6 / reach**power,),
            zero=0.0,
        )
    for name in form.places:
        made[name] = Parameter(
            unit=along, meaning="where it is", low=low, high=high, role="shape", scan=(low, high), nudge=1e-4
        )
    for name, end in zip(form.ends, span, strict=False):
        made[name] = Parameter(
            unit=along, meaning="where the knots end", low=-1e12, high=1e12, role="assumed", scan=(end,)
        )
    for name in (*form.lengths, *(("tau",) if form.memory else ())):
        unit, least, most = along, _NARROWEST * wide, _WIDEST * wide
        if form.memory:
            unit, least, most = "s", 1e-3, 1e6
        elif not bounded:
            least, most = 1e-12, 1e12
        made[name] = Parameter(
            unit=unit,
            meaning={"width": "how wide it is", "length": "how long it is"}.get(name, "its length in x"),
            low=least,
            high=most,
            role="shape",
            scan=(least, most),
            logarithmic=True,
        )
    return made


PHRASES: Mapping[str, str] = {one.word: one.phrase for one in reversed([*OVER.values()])}
