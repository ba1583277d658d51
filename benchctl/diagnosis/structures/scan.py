"""Starting points of the search for structures: a scan of all places of all shapes over all coordinates.

A structure is a function of one coordinate, times a factor of its stage: the volts due to the rate for the scale
factor, the acceleration for a delay. The pull of the residual (its gradient) is therefore summed once over narrow bins
of the coordinate; the expected gain of any function then follows from products of these sums.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.optimize
from scipy.signal import oaconvolve

from benchctl.diagnosis.drive.problem import DriveProblem
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.search.pull import Pull, peaks
from benchctl.estimation.fit import Fit, inverse
from benchctl.side_by_side import shared_out
from benchctl.signals.binning import bin_of
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.thermal_hysteresis import play
from benchctl_instruments.physics.structure_places import CHAMBER_C, OVER, Span, StructureStage, last_sign
from benchctl_instruments.physics.structure_shapes import SHAPES
from benchctl_instruments.physics.structures import Structure, lagged_in_parts, structure

Structurable = GyroProblem | DriveProblem
"""Problems of the parts of the bench in which structures are searched."""
_BINS = 1000
_EDGES, _STEPS = 60, 160
_APART = 1e-3
"""Minimum share of the power of two steps that they do not have in common."""
_UNSEEN, _RARE = 1e-7, 1e-9
"""Minimum power of a shape after projection on the fit, relative to its total and to its largest possible power."""
_STEP_WIDTHS = (0.003, 0.03, 0.1)
_BUMPS = (0.004, 0.01, 0.025, 0.06, 0.15)
_PERIODS = np.geomspace(0.02, 2.0, 110)
_SETTLING = np.geomspace(0.01, 1.0, 12)
_MEMORIES_S = np.geomspace(2.0, 2000.0, 13)
_BURST_PERIODS, _NEAR = 400, 21
_FEWEST_BURSTS = 3
_PHASES = 48
_FEWEST_CYCLES, _MOST_CYCLES, _CYCLES, _CYCLE_PHASES = 3.0, 25.0, 90, 12
_POWERS = (0.4, 0.6, 1.5, 2.0, 3.0)
_SIGNS = ("negative", "positive", "either")
_BETWEEN_WAYS = np.array([-1.5, -0.5, 0.5, 1.5])
_CURVES = ("spline6", "spline12", "spline24")
_ALONG = (
    "step",
    "step_below",
    "plateau",
    "kink",
    "kink_below",
    "power",
    "power_below",
    "bend",
    "bump",
    "resonance",
    "wave",
    "line",
    "parabola",
    "cubic",
    "rise",
    "fall",
    *_CURVES,
)
_ALIKE: Mapping[tuple[StructureStage, str], tuple[str, ...]] = {
    **dict.fromkeys((("torque", "rate"), ("torque", "acceleration")), ("line", "bend")),
    ("heat", "time"): ("line", *_CURVES),
    ("heat", "chamber_temp"): ("line", "bend", *_CURVES),
    ("heat", "heater"): ("line", "parabola", "bend", *_CURVES),
}
"""Shapes that are not tried over a coordinate.

The baseline has slopes there, with which a bend equals a kink, or a named effect has this shape. A spline would follow
a disturbance.
"""
_REMEMBERED = ("abs_rate", "rate", "rate_sign", "gyro_temp", "gyro_temp_rate", "setpoint")
_BACKLASHES = np.geomspace(0.005, 0.4, 14)
_Place = tuple[StructureStage, str, str]
_FACTORS: Mapping[StructureStage, tuple[str, ...]] = {
    "scale": ("abs_rate", "gyro_temp_rate"),
    "bias": ("abs_rate", "rate_sign", "last_sign"),
}
_PRODUCTS: tuple[_Place, ...] = tuple(
    (stage, over, times)
    for stage, factors in _FACTORS.items()
    for over in ("gyro_temp", "angle", "time")
    for times in factors
)
"""Pairs of coordinates: a function of the first, in proportion to the second, which has a natural zero."""
_CLEARLY_MORE = 1.1
"""Minimum expected gain of a function of two coordinates, as a multiple of the best function of one."""
_OF_STAGE: Mapping[StructureStage, tuple[str, ...]] = {
    "scale": ("gyro_temp", "gyro_temp_rate", "time", "angle", "chamber_temp", "setpoint", "abs_rate", "last_sign"),
    "bias": tuple(OVER),
    "sampling": ("gyro_temp", "gyro_temp_rate", "time", "abs_rate"),
    "torque": ("time", "angle", "rate", "abs_rate", "rate_sign", "acceleration"),
}
"""Coordinates over which structures of a stage are searched."""
_MOVED, _NUDGED = 2.0, 0.2
"""The refinement of a place starts with a twentieth of these: of its logarithm, and of the range."""
_MOST_JUMPS = 6
_LEAST_JUMP = 60.0
_STANDS_OUT, _NOISY = 4.0, 4.0
"""Minimum gain relative to the next best place, and maximum residual power relative to the noise, of a jump."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Begun:
    """The best place of a shape: the structure there, its expected gain, and the number of places tried.

    `along` holds the sums over its coordinate; None if the structure has a memory. `share` is the fraction of their
    rows in the fitted steps.
    """

    effect: Structure
    gain: float
    places: int
    along: Along | None = None
    share: float = 1.0

    @property
    def promise(self) -> float:
        """The expected gain in the fitted steps."""
        return self.share * self.gain

    def refined(self) -> Begun:
        """Refine the place between the scanned ones."""
        return self if self.along is None else self.along.refined(self)


def begun_everywhere(problem: Structurable, pull: Pull, in_time: Pull) -> list[Begun]:
    """Return the best place of each shape at each stage over each coordinate, if it has an expected gain.

    `in_time` is the pull of all steps: an event at an instant is visible only in the step of that instant.
    """
    scanned = {over_time: _seen(problem, one) for over_time, one in ((False, pull), (True, in_time))}
    stages = scanned[False][2].keys()
    places = [(stage, over, "") for stage in stages for over in _OF_STAGE.get(stage, ())]
    band = problem.band if isinstance(problem, GyroProblem) else None

    def begun(places: Sequence[_Place]) -> list[Begun]:
        over = places[0][1]
        pulling, known, factors, coordinates = scanned[over == "time"]
        share = pull.fitted.rows / pulling.fitted.rows
        factored = {
            place: factors[place[0]] * coordinates[place[2]] if place[2] else factors[place[0]] for place in places
        }
        found = _places_along(problem, pulling, known, factored, coordinates[over])
        return [replace(one, share=share) for one in found]

    known = [
        one
        for one in (*places, *(place for place in _PRODUCTS if place[0] in stages))
        if {*one[1:]} - {""} <= scanned[False][-1].keys()
        and (band is None or not structure(one[0], one[1], "line", times=one[2]).momentary)
    ]
    of_each = [[one for one in known if one[1] == over] for over in dict.fromkeys(one[1] for one in known)]
    found = list(itertools.chain.from_iterable(shared_out(begun, of_each)))
    most = max((one.promise for one in found if not one.effect.times), default=0.0)
    return [one for one in found if not one.effect.times or one.promise > _CLEARLY_MORE * most]


def _seen(
    problem: Structurable, pull: Pull
) -> tuple[Pull, list[FloatArray], Mapping[StructureStage, FloatArray], Mapping[str, FloatArray]]:
    """Return the pull of a fit's residual, that of its derivatives, the factors of the stages, and the coordinates.

    The part of the residual that the fit's own parameters would still remove at full convergence is subtracted.
    """
    fitted = pull.fitted
    known = [pull.of_known(i) for i in range(len(fitted.numbers))]
    left = pull.pull.copy()
    for one, step in zip(known, (fitted.step_left / fitted.deviation).tolist(), strict=True):
        left -= step * one
    return replace(pull, pull=left), known, factors_of(problem, fitted), coordinates_of(problem, fitted)


def coordinates_of(problem: Structurable, fitted: Fit) -> dict[str, FloatArray]:
    """Return every coordinate that varies in a recording, as structures use it; arrays of shape (n,).

    `output` is the predicted output: the measured output contains the residual, so a function of it would follow any
    residual.
    """
    values = {name: one for name, one in problem.coordinates.items() if name in OVER} | {"output": fitted.predicted}
    values["time"] = problem.clock_s
    if isinstance(problem, GyroProblem):
        frame, band = problem.frame, problem.band
        made = {"last_sign": last_sign(frame.rate_dps)}
        made["chamber_temp"] = frame.auxiliary.get(CHAMBER_C, np.zeros(frame.rows))
        values |= {name: one if band is None else one[band.rows] for name, one in made.items()}
    rows = problem.usable
    return {name: one for name, one in values.items() if np.isfinite(one[rows]).all() and np.ptp(one[rows]) > 0.0}


def factors_of(problem: Structurable, fitted: Fit) -> Mapping[StructureStage, FloatArray]:
    """Return the factor of each stage from its function to the measured quantity; arrays of shape (n,)."""
    if isinstance(problem, DriveProblem):
        return {"torque": np.ones_like(fitted.predicted)}
    K0, U0 = fitted.point.baseline[:2].tolist()
    return {
        "scale": fitted.predicted - U0,
        "bias": np.ones_like(fitted.predicted),
        "sampling": -K0 * problem.coordinates["acceleration"],
    }


def _places_along(
    problem: Structurable,
    pull: Pull,
    known: list[FloatArray],
    factors: Mapping[_Place, FloatArray],
    values: FloatArray,
) -> Iterator[Begun]:
    """Yield the best place of each shape over a coordinate, for each stage with its factor."""
    rows = pull.rows
    span = float(values[rows].min()), float(values[rows].max())
    if not span[0] < span[1]:
        return
    yield from everywhere([Along.of(pull, known, values, factor, span, place) for place, factor in factors.items()])
    for (stage, over, times), factor in factors.items():
        if isinstance(problem, GyroProblem) and over in _REMEMBERED and stage != "sampling" and not times:
            yield from _remembered(problem, pull, known, (stage, over, times), values, factor, span)


def everywhere(alongs: Sequence[Along]) -> Iterator[Begun]:
    """Yield the best place of each shape, for each of several sums over the same bins of one coordinate."""
    over, span = alongs[0].place[1], alongs[0].span
    if OVER[over].ways is not None:
        shapes: tuple[str, ...] = _SIGNS
    else:
        shapes = (*_ALONG, *(("exponential",) if over == "time" else ()))
    for shape in shapes:
        sought = [one for one in alongs if shape not in _ALIKE.get(one.place[:2], ())]
        yield from _best(shape, list(_grid(over, shape, span)), sought)
    for one in alongs:
        stage, _, times = one.place
        if times:
            continue
        if over in ("time", "gyro_temp") or (stage, over) in (("torque", "angle"), ("heat", "chamber_temp")):
            yield from one.two_steps()
        if over == "time":
            yield from one.bursts() if one.information.ndim == 1 else _best("bursts", list(_cycles(span)), [one])


def _best(shape: str, places: Sequence[Mapping[str, float]], alongs: Sequence[Along]) -> Iterator[Begun]:
    """Yield the best of some places of a shape for each of several sums over the same bins, if its gain is positive."""
    if not places or not alongs:
        return
    kinds = [one.kind(shape) for one in alongs]
    sizes = tuple(SHAPES[shape].sizes)
    unit = dict.fromkeys(sizes, 0.0) | {
        name: parameter.scan[0] for name, parameter in kinds[0].parameters.items() if parameter.role == "assumed"
    }
    function, middle = SHAPES[shape].function, alongs[0].middle
    columns = _Columns(np.array([[function({**unit, **it, name: 1.0}, middle) for name in sizes] for it in places]))
    for along, kind in zip(alongs, kinds, strict=True):
        gain, weights = along.gains(columns)
        first = int(np.argmax(gain))
        if gain[first] > 0.0:
            values = {**unit, **places[first], **dict(zip(sizes, weights[first].tolist(), strict=True))}
            yield Begun(effect=kind.make(values), gain=float(gain[first]), places=len(places), along=along)


@dataclass(frozen=True)
class _Columns:
    """Functions of a coordinate in its b bins: k functions of size one at each of m places; shape (m, k, b)."""

    values: FloatArray

    @cached_property
    def squares(self) -> FloatArray:
        """The squares, for one function per place; shape (m, b)."""
        return np.asarray(self.values[:, 0] ** 2)

    @cached_property
    def largest(self) -> FloatArray:
        """The square of the largest value at each place, shape (m,)."""
        return np.asarray(np.abs(self.values).max(axis=(1, 2)) ** 2)


@dataclass(frozen=True, kw_only=True)
class Along:
    """The pull of a residual summed over bins of a coordinate with centres `middle` (b,).

    `pull` and `information` (b,) are sums over the rows of a bin, `known` (b, p) those of the pull of the fit's
    derivatives. If a bin acts on many rows, `information` has the shape (b, b).
    """

    middle: FloatArray
    pull: FloatArray
    information: FloatArray
    known: FloatArray
    covariance: FloatArray
    span: Span
    place: _Place

    @classmethod
    def of(
        cls, pull: Pull, known: list[FloatArray], values: FloatArray, factor: FloatArray, span: Span, place: _Place
    ) -> Along:
        """Return the sums for a function of a coordinate's `values`, times `factor` in the same row; (n,) each."""
        edges = np.linspace(*span, _BINS + 1) if OVER[place[1]].ways is None else _BETWEEN_WAYS
        bins = bin_of(np.clip(values, *span), edges)

        def summed(of: FloatArray) -> FloatArray:
            return np.asarray(np.bincount(bins, of, minlength=edges.size - 1), dtype=np.float64)

        return cls(
            middle=0.5 * (edges[:-1] + edges[1:]),
            pull=summed(pull.pull * factor),
            information=summed(pull.information * factor**2),
            known=np.stack([summed(one * factor) for one in known], axis=1),
            covariance=pull.fitted.inverse_information,
            span=span,
            place=place,
        )

    def kind(self, shape: str) -> type[Structure]:
        """Return the structure class of a shape at this stage and coordinate."""
        stage, over, times = self.place
        return structure(stage, over, shape, self.span, times)

    def refined(self, begun: Begun) -> Begun:
        """Return the same shape at the place of the largest expected gain near its start."""
        kind, started = type(begun.effect), begun.effect.values
        shaped = {name: one for name, one in kind.parameters.items() if one.role == "shape"}
        sizes = tuple(SHAPES[kind.shape].sizes)
        if not shaped:
            return begun
        nothing, function = {**started, **dict.fromkeys(sizes, 0.0)}, SHAPES[kind.shape].function
        wide = self.span[1] - self.span[0]

        def there(moves: FloatArray) -> dict[str, float]:
            values = {}
            for (name, one), move in zip(shaped.items(), moves.tolist(), strict=True):
                by = move - 1.0  # the first step of the search is 0.05
                was = started[name]
                value = was * math.exp(min(_MOVED * by, 9.0)) if one.logarithmic else was + _NUDGED * wide * by
                values[name] = min(max(value, one.low), one.high)
            return values

        def promised(moves: FloatArray) -> tuple[float, FloatArray]:
            at = {**nothing, **there(moves)}
            columns = np.array([[function({**at, name: 1.0}, self.middle) for name in sizes]])
            gain, weights = self.gains(_Columns(columns))
            return float(gain[0]), weights[0]

        def cost(moves: FloatArray) -> float:
            return -promised(moves)[0]

        start = np.ones(len(shaped))
        found = scipy.optimize.minimize(
            cost, start, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 0.1, "maxfev": 150}
        )
        gain, weights = promised(found.x)
        if gain <= begun.gain:
            return begun
        values = {**nothing, **there(found.x), **dict(zip(sizes, weights.tolist(), strict=True))}
        return replace(begun, effect=kind.make(values), gain=gain)

    def gains(self, functions: _Columns) -> tuple[FloatArray, FloatArray]:
        """Return the expected gain of the functions at each place, shape (m,), and their best sizes, shape (m, k)."""
        columns = functions.values
        known = columns @ self.known
        if self.information.ndim > 1:
            power = np.einsum("mkb,mlb->mkl", columns @ self.information, columns, optimize=True)
        elif columns.shape[1] == 1:
            power = (functions.squares @ self.information)[:, None, None]
        else:
            power = np.einsum("mkb,b,mlb->mkl", columns, self.information, columns, optimize=True)
        own = power - np.einsum("mkp,mlp->mkl", known @ self.covariance, known)
        score = columns @ self.pull
        diagonal = np.einsum("mkk->mk", own)
        least = _RARE * functions.largest * float(self.information.sum())
        distinct = (diagonal > np.maximum(_UNSEEN * np.einsum("mkk->mk", power), least[:, None])).all(axis=1)
        weights = np.zeros(score.shape)
        for place in np.flatnonzero(distinct).tolist() if columns.shape[1] > 1 else ():
            weights[place] = inverse(own[place]) @ score[place]
        if columns.shape[1] == 1:
            weights[distinct, 0] = score[distinct, 0] / own[distinct, 0, 0]
        return np.einsum("mk,mk->m", weights, score), weights

    def two_steps(self) -> Iterator[Begun]:
        """Yield the pair of places at which two steps together explain most."""
        low, wide = self.span[0], self.span[1] - self.span[0]
        ats = low + wide * np.linspace(0.0, 1.0, _STEPS + 2)[1:-1]
        steps = (self.middle > ats[:, None]).astype(np.float64)
        known, score = steps @ self.known, steps @ self.pull
        weighed = steps * self.information if self.information.ndim == 1 else steps @ self.information
        own = weighed @ steps.T - known @ self.covariance @ known.T
        alone = np.diag(own)
        left = np.outer(alone, alone) - own**2
        separable = left > _APART * np.outer(alone, alone)
        separable &= np.triu(np.ones_like(separable), 1) > 0.0
        separable &= np.minimum.outer(alone, alone) > _RARE * float(self.information.sum())
        gain = np.outer(score**2, alone) + np.outer(alone, score**2) - 2.0 * np.outer(score, score) * own
        gain = np.divide(gain, left, out=np.zeros_like(gain), where=separable)
        first, then = np.unravel_index(int(np.argmax(gain)), gain.shape)
        if gain[first, then] > 0.0:
            both = [int(first), int(then)]
            changes = np.linalg.solve(own[np.ix_(both, both)], score[both]).tolist()
            places = dict(zip(("at", "at_2"), ats[both].tolist(), strict=True))
            values = {"change": changes[0], "change_2": changes[1], **places, "width": 0.5 * wide / _STEPS}
            kind = self.kind("steps")
            found = float(gain[first, then])
            yield Begun(effect=kind.make(values), gain=found, places=_STEPS**2 // 2, along=self)

    def bursts(self) -> Iterator[Begun]:
        """Yield periodic bursts of equal length, found by folding the bins with each period."""
        wide = self.span[1] - self.span[0]
        often = np.linspace(_FEWEST_BURSTS / wide, _BINS / (20.0 * wide), _BURST_PERIODS)
        best = max((self._folded(1.0 / one) for one in often.tolist()), key=lambda one: one[0])
        near = 1.0 / best[1]["period"] + (often[1] - often[0]) * np.linspace(-1.0, 1.0, _NEAR)
        best = max((self._folded(1.0 / one) for one in near.tolist()), key=lambda one: one[0])
        kind = self.kind("bursts")
        column = kind.make({**best[1], "change": 1.0}).value_at(self.middle)
        gain, weights = self.gains(_Columns(column[None, None]))
        if gain[0] > 0.0:
            effect = kind.make({**best[1], "change": float(weights[0, 0])})
            yield Begun(effect=effect, gain=float(gain[0]), places=_BURST_PERIODS * _PHASES, along=self)

    def _folded(self, period: float) -> tuple[float, dict[str, float]]:
        """Return the gain of bursts of a period in addition to a constant, and their start, period and length."""
        low = self.span[0]
        phase = (np.mod(self.middle - low, period) / period * _PHASES).astype(np.int64)
        folded = (np.bincount(phase, one, minlength=_PHASES)[:_PHASES] for one in (self.pull, self.information))
        pulls, powers = (np.concatenate([[0.0], np.cumsum(np.tile(one, 2))]) for one in folded)
        total = float(self.information.sum())
        best = -1.0, 0, 2
        for length in range(2, _PHASES // 2):
            inside, own = (one[length : length + _PHASES] - one[:_PHASES] for one in (pulls, powers))
            own = own * (1.0 - own / max(total, 1e-300))
            gain = np.divide(inside**2, own, out=np.zeros_like(own), where=own > 1e-12 * total)
            place = int(np.argmax(gain))
            best = max(best, (float(gain[place]), place, length))
        gained, place, length = best
        return gained, {
            "at": low + place / _PHASES * period,
            "period": period,
            "length": length / _PHASES * period,
        }


def _remembered(
    problem: GyroProblem,
    pull: Pull,
    known: list[FloatArray],
    place: _Place,
    values: FloatArray,
    factor: FloatArray,
    span: Span,
) -> Iterator[Begun]:
    """Yield the best first-order lag of a coordinate, and the best backlash of the gyro temperature."""
    stage, over, _ = place
    longest, wide = float(np.ptp(problem.time_s)), span[1] - span[0]
    taus = [tau for tau in _MEMORIES_S.tolist() if tau < 0.5 * longest]
    looked: list[tuple[str, str, list[float]]] = [("memory", "tau", taus)]
    if over == "gyro_temp" and not problem.recorded.any():
        looked.append(("hysteresis", "width", (wide * _BACKLASHES).tolist()))
    for shape, name, lengths in looked:
        kind = structure(stage, over, shape, span)
        best: tuple[float, float, float] | None = None
        for length in lengths:
            column = factor * (_lag(problem, values, length) if shape == "memory" else _held(values, length))
            score = float(column @ pull.pull)
            power = float(np.sum(column**2 * pull.information))
            crossed = np.array([float(column @ one) for one in known])
            own = power - float(crossed @ pull.fitted.inverse_information @ crossed)
            if own > _UNSEEN * power > 0.0 and (best is None or score**2 / own > best[0]):
                best = score**2 / own, score / own, length
        if best is not None:
            yield Begun(effect=kind.make({"c1": best[1], name: best[2]}), gain=best[0], places=len(lengths))


def _lag(problem: GyroProblem, values: FloatArray, tau_s: float) -> FloatArray:
    """Return the first-order lag of values, shape (n,), through all pauses; each recording starts anew."""
    begun = zip(problem.stretches, problem.frame.origins_s, strict=True)
    parts = ((rows, problem.interval_s, origin_s) for rows, origin_s in begun)
    return lagged_in_parts(values, problem.time_s, parts, tau_s)


def _held(values: FloatArray, half_width: float) -> FloatArray:
    return play(values, half_width, float(values[0])) - values


def _grid(over: str, shape: str, span: Span) -> Iterator[dict[str, float]]:
    """Yield places over the range of a coordinate; over a signed one, steps and kinks point away from zero."""
    low, wide = span[0], span[1] - span[0]
    signed = OVER[over].signed and span[0] < 0.0 < span[1]

    def ats(count: int, below: bool | None = None) -> list[float]:
        places = [low + wide * (i + 1) / (count + 1) for i in range(count)]
        return [at for at in places if not signed or below is None or (at < 0.0) == below]

    if shape in ("step", "step_below"):
        if shape == "step" or signed:
            below = shape == "step_below"
            for width in _STEP_WIDTHS:
                count = min(round(2.0 / width), _BINS // 2)
                yield from ({"at": at, "width": width * wide} for at in ats(count, below))
    elif shape in ("kink", "kink_below"):
        yield from ({"at": at} for at in ats(120, shape == "kink_below"))
    elif shape in ("power", "power_below"):
        places = ats(40, shape == "power_below")
        yield from ({"at": at, "exponent": exponent} for at in places for exponent in _POWERS)
    elif shape == "bend":
        yield from ({"at": at} for at in ats(60))
    elif shape in ("bump", "resonance"):
        for width in _BUMPS:
            yield from ({"at": at, "width": width * wide} for at in ats(min(round(2.0 / width), _BINS // 2)))
    elif shape == "plateau":
        edges = ats(_EDGES)
        yield from ({"at": at, "length": until - at} for at in edges for until in edges if until > at)
    elif shape == "wave":
        turns = [360.0 / order for order in range(1, 25)]
        yield from ({"period": period} for period in (turns if over == "angle" else (wide * _PERIODS).tolist()))
    elif shape in ("exponential", "rise", "fall"):
        yield from ({"tau": share * wide} for share in _SETTLING.tolist())
    else:
        yield {}


def _cycles(span: Span) -> Iterator[dict[str, float]]:
    """Yield the places of periodic bursts, for several periods, lengths and phases."""
    low, wide = span[0], span[1] - span[0]
    for count in np.geomspace(_FEWEST_CYCLES, _MOST_CYCLES, _CYCLES).tolist():
        every = wide / count
        for share in (0.15, 0.3, 0.5, 0.7):
            yield from (
                {"at": low + i / _CYCLE_PHASES * every, "period": every, "length": share * every}
                for i in range(_CYCLE_PHASES)
            )


def encoder_jumps(problem: GyroProblem, pull: Pull, noise: float) -> list[Structure]:
    """Return the permanent jumps of the encoder's angle, the largest first.

    A jump appears in the rate as the step response of the filters. It is accepted only if there are few such places, if
    its gain clearly exceeds that of all others, and if only `noise` (whitened) remains there. An error of the response
    to motion appears at every start and stop of the table; the ends of a temporary bias change do not match a jump.
    """
    motion = problem.frame.motions[0]
    if problem.band is not None:
        return []
    responses = [np.cumsum(kernel) for kernel in motion.filters]
    longest = max(one.size for one in responses)
    narrow, wide = (np.pad(one, (longest - one.size) // 2) for one in responses)
    K0 = float(pull.fitted.point.baseline[0])
    sudden = problem.frame.sudden
    calm = 1.0 - sudden

    def met(values: FloatArray, response: FloatArray) -> FloatArray:
        return np.asarray(oaconvolve(values, response[::-1], mode="same"))

    score = -K0 * (met(calm * pull.pull, narrow) + met(sudden * pull.pull, wide))
    power = K0**2 * (
        met(calm**2 * pull.information, narrow**2)
        + met(sudden**2 * pull.information, wide**2)
        + 2.0 * met(calm * sudden * pull.information, narrow * wide)
    )
    power = np.maximum(power, 1e-3 * float(np.median(power)))
    gain = score**2 / power
    reach = longest // 2
    places = peaks(gain, _MOST_JUMPS + 1, 2 * reach)
    gains = [float(gain[place]) for place in places]
    count = max(
        (i + 1 for i in range(min(len(places) - 1, _MOST_JUMPS)) if gains[i] > _STANDS_OUT * gains[i + 1]), default=0
    )
    if not count or gains[count - 1] < _LEAST_JUMP:
        return []
    clock = problem.clock_s
    rows = pull.rows
    squares = np.where(rows, pull.fitted.white, 0.0) ** 2

    def leaves_noise(place: int) -> bool:
        near = slice(max(place - reach, 0), place + reach + 1)
        left = float(squares[near].sum()) - float(gain[place]) * pull.fitted.deviation**2
        return left < _NOISY * noise**2 * float(np.count_nonzero(rows[near]))

    kind = structure("encoder", "time", "jump", (float(clock[rows].min()), float(clock[rows].max())))
    found = []
    for place in filter(leaves_noise, places[:count]):
        at = 0.5 * float(clock[max(place - 1, 0)] + clock[place])
        found.append(kind.make({"change": 3600.0 * float(score[place] / power[place]), "at": at}))
    return found
