"""Structures: unnamed effects at a stage, as a function of a coordinate with a shape that a search has found.

A structure is an effect made from a stage, a coordinate and a shape. Its identifier contains them:
`kink_of_scale_over_gyro_temp`, or `kink_of_scale_over_gyro_temp_times_abs_rate` if it is proportional to a second
coordinate. In a model file it is a table of `[discovered]`; the name of a second one of the same kind ends with `_2`:

    [discovered.kink_of_scale_over_gyro_temp]
    at = 27.7
    above = -4.8e-4

Its function f acts on the scale factor as (U − U0)·(1 + f), on the bias as U + f, on the sampling as a delay f, on the
encoder's angle as θ + f, on the noise as σ·(1 + f), on the torque of a table's drive as τ + f, on the heat of a chamber
as T_room + f, through the lag of its air, and on the loss of that air as loss·(1 + f). Structures of a drive or chamber
are tables of `[parts.drive.effects]` or `[parts.chamber.effects]`; their coordinates are those of the part's rows.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, make_dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import scipy  # scipy.signal is loaded at its first use

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Signals
from benchctl_instruments.physics.chamber_effects.effect import ChamberSignals
from benchctl_instruments.physics.effects.draws import normals
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect, Role
from benchctl_instruments.physics.effects.thermal_hysteresis import play
from benchctl_instruments.physics.structure_places import ACTS, OVER, Span, StructureStage, last_sign
from benchctl_instruments.physics.structure_shapes import SHAPES, ShapeInWords

_EVERYWHERE: Span = (-1e12, 1e12)
_ARCSEC = 3600.0
_TABULATED = 4000
"""Number of air temperatures at which functions of it are tabulated, with linear interpolation."""
_WITHIN = 16
"""Number of times within a sample at which functions of time are averaged."""
_NARROWEST, _WIDEST = 1e-3, 2.0
"""Limits of widths and periods, relative to the coordinate's range."""

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
"""Named effects that may look like a structure at a stage over a coordinate."""
_OTHER_SIDE = {"step": "step_below", "step_below": "step", "kink": "kink_below", "kink_below": "kink"}
_ONE_OF = "|".join(OVER)
_NAME = re.compile(rf"({'|'.join(SHAPES)})_of_({'|'.join(ACTS)})_over_({_ONE_OF})(?:_times_({_ONE_OF}))?(?:_[2-9])?")


class Structure(PhysicalEffect):
    """Base class of structures. The subclasses made by `structure` have the shape's parameters as fields.

    Attributes
    ----------
    shape
        One of `SHAPES`.
    over
        The coordinate, one of `OVER`.
    times
        A second coordinate to which the function is proportional, or an empty string.
    word
        The coordinate, or both, as reported by a diagnosis.
    acts_on
        One of `ACTS`.
    """

    shape: ClassVar[str]
    over: ClassVar[str]
    times: ClassVar[str]
    word: ClassVar[str]
    acts_on: ClassVar[StructureStage]

    def value_at(self, x: FloatArray) -> FloatArray:
        """Return the function f at values of the coordinate, shape (n,)."""
        return np.asarray(SHAPES[self.shape].function(self.values, x), dtype=np.float64)

    def function_of(self, signals: Signals) -> tuple[FloatArray, Signals]:
        """Return the function f of signals, shape (n,), and the signals with its updated memory."""
        x = OVER[self.over].values(signals)
        if self.pointwise:
            f = self.value_at(x)
            return f * OVER[self.times].values(signals) if self.times else f, signals
        kept = signals.memory.get(self.identifier)
        if self.over == "last_sign":
            x = last_sign(signals.rate_dps, 0.0 if kept is None else float(kept[0]))
            carried = np.array([x[-1]])
        elif self.shape == "hysteresis":
            played = play(x, self.values["width"], float(x[0] if kept is None else kept[0]))
            x, carried = played - x, played[-1:].copy()
        if self.shape == "memory":
            x, carried = lagged(x, signals.time_s, signals.interval_s, self.values["tau"], kept)
        return self.value_at(x), replace(signals, memory={**signals.memory, self.identifier: carried})

    @property
    def is_smooth(self) -> bool:
        """Whether it is a spline, which can follow any smooth function."""
        return len(SHAPES[self.shape].ends) > 1

    @property
    def is_opening(self) -> bool:
        """Whether it changes a chamber's loss: a door or a lid that is open for a time."""
        return self.acts_on == "loss"

    @property
    def is_stepped(self) -> bool:
        """Whether it has steps, each with a width."""
        return self.shape in ("step", "step_below", "steps")

    @property
    def is_sharp(self) -> bool:
        """Whether it is a step and no bound is reached except, possibly, the lower one of its width."""
        width = self.parameters.get("width")
        inside = all(one.low < self.values[name] < one.high for name, one in self.parameters.items() if name != "width")
        return self.is_stepped and width is not None and self.values["width"] < width.high and inside

    @property
    def plausible(self) -> bool:
        """Whether a plateau ends within the coordinate's range; otherwise it is a step. True for other shapes."""
        return self.shape != "plateau" or self.values["at"] + self.values["length"] < self.parameters["at"].high

    def apply(self, signals: Signals) -> Signals:
        """Return the signals with the structure applied."""
        change, signals = self.function_of(signals)
        return self.changed(signals, change)

    def changed(self, signals: Signals, change: FloatArray) -> Signals:
        """Return the signals with the structure applied, given its function `change` (n,)."""
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
        """Return the additional noise that increases existing noise of σ to σ·(1 + f), f ≥ 0."""
        drawn = normals(getattr(self, "seed", 1), self.identifier, signals.first_index, signals.time_s.size, 1)[:, 0]
        more = np.sqrt(np.maximum((1.0 + change) ** 2 - 1.0, 0.0))
        return np.asarray(drawn * more * getattr(self, "noise_v_rms", 0.0))

    def says(self) -> str:
        """Return a sentence that describes the structure with its values."""
        in_words = ShapeInWords(stage=self.acts_on, over=self.over, times=self.times, values=self.values)
        return SHAPES[self.shape].sentence(in_words)


def lagged(
    x: FloatArray, time_s: FloatArray, interval_s: float, tau_s: float, kept: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the first-order lag of x, shape (n,), and its state for the next call (`kept`).

    Without a state, the lag starts settled. During a pause, x is assumed to have its last value for the first half and
    its next value for the second half: a table that reverses passes rest about in the middle.
    """
    share = -math.expm1(-interval_s / tau_s)
    value = float(x[0])
    if kept is not None:
        since_s, y_kept, x_kept = kept.tolist()
        left = math.exp(-0.5 * max(float(time_s[0]) - since_s, 0.0) / tau_s)
        value += (x_kept - value + (y_kept - x_kept) * left) * left
    y, _ = scipy.signal.lfilter([share], [1.0, share - 1.0], x, zi=[(1.0 - share) * value])
    return y, np.array([time_s[-1] + interval_s, y[-1], x[-1]])


def lagged_in_parts(
    x: FloatArray, time_s: FloatArray, parts: Iterable[tuple[slice, float, float]], tau_s: float
) -> FloatArray:
    """Return the first-order lag of x, shape (n,), through all pauses; each recording starts anew.

    Each part has its rows, its interval [s], and the time [s] at which its recording began; the parts cover all rows.
    """
    y, kept, begun_s = np.empty_like(x), None, math.nan
    for rows, interval_s, origin_s in parts:
        y[rows], kept = lagged(x[rows], time_s[rows], interval_s, tau_s, kept if origin_s == begun_s else None)
        begun_s = origin_s
    return y


def pushed(
    signals: ChamberSignals, structures: Sequence[Structure], clock_s: FloatArray, gain: float, reach_c: Span
) -> ChamberSignals:
    """Return the signals with the structures: heat over time, over the air temperature or the heater; loss over time.

    A function of the heater is added to the drive. `clock_s` (n,) starts with the recording; `gain` [K] is that of the
    drive. Outside `reach_c`, a function of the air temperature is constant. A loss does not become negative.
    """
    at_c = np.linspace(*reach_c, _TABULATED)
    of_air, push_c, drive, loss = np.zeros_like(at_c), np.zeros_like(clock_s), signals.drive, signals.loss
    for one in structures:
        if one.is_opening:
            loss = loss * np.maximum(1.0 + _mean_at(one, clock_s, signals.interval_s), 0.0)
        elif one.over == "chamber_temp":
            of_air += one.value_at(at_c)
        elif one.over == "heater" and gain:
            drive = drive + one.value_at(signals.drive) / gain
        elif one.over == "time":
            push_c += _mean_at(one, clock_s, signals.interval_s)
    of_the_air = np.stack([at_c, of_air]) if of_air.any() else None
    return replace(signals, drive=drive, loss=loss, push_c=push_c, push_of_air=of_the_air)


def _mean_at(one: Structure, clock_s: FloatArray, interval_s: float) -> FloatArray:
    """Return the means of a function of time over the samples, shape (n,): its edges move within a sample too."""
    within = (np.arange(_WITHIN) + 0.5) / _WITHIN - 0.5
    values = one.value_at(np.add.outer(within * interval_s, clock_s).ravel())
    return np.asarray(values.reshape(_WITHIN, -1).mean(axis=0))


@lru_cache(maxsize=1024)
def structure(
    stage: StructureStage, over: str, shape: str, span: Span = _EVERYWHERE, times: str = ""
) -> type[Structure]:
    """Return the structure class of a shape at a stage over a coordinate with values in `span`."""
    acts, coordinate = ACTS[stage], OVER[over]
    parameters = _parameters(stage, over, shape, span, times)
    lagged = SHAPES[shape].memory == "lag"
    remembers = bool(SHAPES[shape].memory) or over == "last_sign"
    word = "*".join(dict.fromkeys(OVER[one].word for one in (over, times) if one))
    namespace = {
        "identifier": f"{shape}_of_{stage}_over_{over}" + (f"_times_{times}" if times else ""),
        "stage": acts.chain,
        "acts_on": stage,
        "over": over,
        "times": times,
        "word": word,
        "shape": shape,
        "pointwise": not remembers,
        "several": not remembers and stage != "noise",
        "timeless": remembers and not lagged,
        "momentary": coordinate.momentary or stage == "sampling" or (bool(times) and OVER[times].momentary),
        "words": f"A structure without a name: the {acts.what} depends on {coordinate.phrase}.",
        "equation": f"{acts.equation}, f = {SHAPES[shape].written(over, times)}",
        "coordinate": f"{word}*rate" if stage == "scale" and word != "rate" and not times else word,
        "excited_by": f"the range of {coordinate.phrase}",
        "look_alikes": _LOOK_ALIKES.get((stage, coordinate.word), ()),
        "parameters": parameters,
        "__doc__": f"The {shape} of the {stage} over {over}.",
    }
    return type("Discovered", (_with_fields(tuple(parameters), stage == "noise"),), namespace)


@lru_cache(maxsize=256)
def _with_fields(names: tuple[str, ...], of_noise: bool) -> type[Structure]:
    """Return a structure class with these parameters as fields; making a dataclass takes long."""
    fields: list[tuple[str, type] | tuple[str, type, object]] = [(name, float) for name in names]
    if of_noise:
        fields += [("noise_v_rms", float, field(default=5e-4)), ("seed", int, field(default=1))]
    return make_dataclass("WithFields", fields, bases=(Structure,), frozen=True, kw_only=True)


def on_the_other_side(effect: Structure) -> Structure | None:
    """Return a step or kink on the other side of its place, up to a constant and a line; None for other shapes."""
    shape = _OTHER_SIDE.get(effect.shape)
    if shape is None:
        return None
    place = effect.parameters["at"]
    other = structure(effect.acts_on, effect.over, shape, (place.low, place.high), effect.times)
    here, there = (next(iter(SHAPES[name].sizes)) for name in (effect.shape, shape))
    values = {name: value for name, value in effect.values.items() if name != here}
    return other.make({**values, there: -effect.values[here]})


def unmoved(effect: Structure, roles: tuple[Role, ...] = ("size", "shape")) -> Structure:
    """Return the structure with its parameters of some roles fixed."""
    kind = type(effect)
    parameters = {
        name: replace(parameter, role="assumed") if parameter.role in roles else parameter
        for name, parameter in kind.parameters.items()
    }
    held: type[Structure] = type(kind.__name__, (kind,), {"parameters": parameters, "__doc__": kind.__doc__})
    return held.make(effect.values)


def freed(effect: Structure) -> Structure:
    """Return the structure with all parameters free that `unmoved` has fixed."""
    kind: type[Structure] = type(effect)
    while "identifier" not in vars(kind):  # a subclass made by `unmoved`
        kind = next(base for base in kind.__bases__ if issubclass(base, Structure))
    return kind.make(effect.values)


def structure_named(identifier: str) -> type[Structure] | None:
    """Return the structure class of an identifier (with or without a suffix `_2`), over any range; None if invalid."""
    match = _NAME.fullmatch(identifier)
    if match is None:
        return None
    shape, stage, over, times = match.groups()
    return structure(next(one for one in ACTS if one == stage), over, shape, times=times or "")


def _parameters(stage: StructureStage, over: str, shape: str, span: Span, times: str) -> Mapping[str, Parameter]:
    """Return the parameters, sizes first, with bounds from the range of the coordinate if it is known."""
    acts, along, form = ACTS[stage], OVER[over].unit, SHAPES[shape]
    low, high = span
    wide, bounded = high - low, span != _EVERYWHERE
    reach = max(abs(low), abs(high), wide) if bounded else 1.0
    made: dict[str, Parameter] = {}
    for name, power in form.sizes.items():
        limit = acts.limit / (reach**power if bounded or not power else 1e-12)
        per = f" ({along})-{power}" if power else ""
        per += f" ({OVER[times].unit})-1" if times else ""
        made[name] = Parameter(
            unit=f"{acts.unit}{per}",
            meaning="what it changes" if not power else "change a unit of the coordinate",
            low=-limit,
            high=limit,
            role="size",
            scan=(1e-6 / reach**power,),
            zero=0.0,
        )
    # a burst may have begun before the range
    first = low - wide if "period" in form.lengths and bounded else low
    for name in form.places:
        made[name] = Parameter(
            unit=along, meaning="where it is", low=first, high=high, role="shape", scan=(low, high), nudge=1e-4
        )
    for name in form.ends:
        end = low if name == "low" else high
        made[name] = Parameter(
            unit=along, meaning="where its range ends", low=-1e12, high=1e12, role="assumed", scan=(end,)
        )
    for name, (least, most) in form.numbers.items():
        made[name] = Parameter(
            unit="1", meaning="a power", low=least, high=most, role="shape", scan=(least, most), logarithmic=True
        )
    for name in (*form.lengths, *(("tau",) if form.memory == "lag" else ())):
        unit, least, most = along, _NARROWEST * wide, _WIDEST * wide
        if form.memory == "lag":
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
