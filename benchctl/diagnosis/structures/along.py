"""The best places of all shapes along one coordinate, from sums of a residual's pull over its bins.

The expected gain of any function of the coordinate follows from products of these sums.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import scipy.optimize

from benchctl.diagnosis.search.pull import CELLS, Pull, shortest_resolved
from benchctl.estimation.fit import inverse
from benchctl.signals.binning import bin_of
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.structure_places import OVER, Span, StructureStage
from benchctl_instruments.physics.structure_shapes import SHAPES
from benchctl_instruments.physics.structures import Structure, structure

_BINS = 1000
_EDGES, _STEPS = 60, 160
_APART = 1e-3
"""Minimum share of the power of two steps that they do not have in common."""
UNSEEN, _RARE = 1e-7, 1e-9
"""Minimum power of a shape after projection on the fit, relative to its total and to its largest possible power."""
_STEP_WIDTHS = (0.003, 0.03, 0.1)
_BUMPS = (0.004, 0.01, 0.025, 0.06, 0.15)
_PERIODS = np.geomspace(0.02, 2.0, 110)
_SETTLING = np.geomspace(0.01, 1.0, 12)
_SIMILAR = ("plateau", "bump", "resonance")
"""Shapes whose column at each scanned place is the same for every coordinate with bins of equal width."""
_BURST_PERIODS, _NEAR = 400, 21
_FEWEST_BURSTS = 3
_PHASES = 48
_FEWEST_CYCLES, _MOST_CYCLES, _CYCLES, _CYCLE_PHASES = 3.0, 25.0, 90, 12
_POWERS = (0.4, 0.6, 1.5, 2.0, 3.0)
_SIGNS = ("negative", "positive", "either")
_BETWEEN_DIRECTIONS = np.array([-1.5, -0.5, 0.5, 1.5])
_BETWEEN_DIRECTIONS = np.array([-1.5, -0.5, 0.5, 1.5])
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
_TWO_STEPS = (("torque", "angle"), ("torque", "swing_angle"), ("heat", "chamber_temp"))
"""Stages and coordinates, apart from those over time and the gyro's temperature, with independent pairs of steps."""
_OF_LOSS = ("plateau",)
"""Shapes of a loss over time: a chamber that is opened and closed. A single step of the loss has a name."""
Place = tuple[StructureStage, str, str]
_MOVED, _NUDGED = 2.0, 0.2
"""The refinement of a place starts with a twentieth of these: of its logarithm, and of the range."""


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


def everywhere(alongs: Sequence[Along]) -> Iterator[Begun]:
    """Yield the best place of each shape, for each of several sums over the same bins of one coordinate."""
    over, span = alongs[0].place[1], alongs[0].span
    if OVER[over].directions is not None:
        shapes: tuple[str, ...] = _SIGNS
    else:
        shapes = (*_ALONG, *(("exponential",) if over == "time" else ()))
    for shape in shapes:
        sought = [one for one in alongs if _is_tried(shape, one.place)]
        places = list(_grid(over, shape, span))
        if shape == "wave":
            places = [one for one in places if one["period"] >= alongs[0].shortest_period]
        yield from _best(shape, places, sought)
    for one in alongs:
        stage, _, times = one.place
        if times or stage == "loss":
            continue
        if over in ("time", "gyro_temp") or (stage, over) in _TWO_STEPS:
            yield from one.two_steps()
        if over == "time":
            yield from one.bursts() if one.information.ndim == 1 else _best("bursts", list(_cycles(span)), [one])


def _is_tried(shape: str, place: Place) -> bool:
    stage, over, _ = place
    return shape in _OF_LOSS if stage == "loss" else shape not in _ALIKE.get((stage, over), ())


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
    if shape in _SIMILAR:
        columns = _similar_columns(shape, middle.size)
    else:
        columns = _Columns(np.array([[function({**unit, **it, name: 1.0}, middle) for name in sizes] for it in places]))
    for along, kind in zip(alongs, kinds, strict=True):
        gain, weights = along.gains(columns)
        first = int(np.argmax(gain))
        if gain[first] > 0.0:
            values = {**unit, **places[first], **dict(zip(sizes, weights[first].tolist(), strict=True))}
            yield Begun(effect=kind.make(values), gain=float(gain[first]), places=len(places), along=along)


@lru_cache(maxsize=len(_SIMILAR))
def _similar_columns(shape: str, bins: int) -> _Columns:
    """Return the columns of a shape that are the same for every range, computed over the range from 0 to 1."""
    middle = (np.arange(bins) + 0.5) / bins
    function = SHAPES[shape].function
    return _Columns(np.array([[function({**it, "change": 1.0}, middle)] for it in _grid("time", shape, (0.0, 1.0))]))


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
    place: Place

    @classmethod
    def of(
        cls,
        pull: Pull,
        known: list[FloatArray],
        values: FloatArray,
        factors: Mapping[Place, FloatArray],
        span: Span,
    ) -> list[Along]:
        """Return the sums for functions of a coordinate's `values`, times each factor in the same row; (n,) each."""
        over = next(iter(factors))[1]
        edges = np.linspace(*span, _BINS + 1) if OVER[over].directions is None else _BETWEEN_DIRECTIONS
        bins = bin_of(np.clip(values, *span), edges)

        def summed(of: FloatArray) -> FloatArray:
            return np.asarray(np.bincount(bins, of, minlength=edges.size - 1), dtype=np.float64)

        return [
            cls(
                middle=0.5 * (edges[:-1] + edges[1:]),
                pull=summed(pull.pull * factor),
                information=summed(pull.information * factor**2),
                known=np.stack([summed(one * factor) for one in known], axis=1),
                covariance=pull.fitted.inverse_information,
                span=span,
                place=place,
            )
            for place, factor in factors.items()
        ]

    @property
    def shortest_period(self) -> float:
        """The shortest period of a wave that the values of the coordinate resolve."""
        information = self.information if self.information.ndim == 1 else np.diagonal(self.information)
        width = (self.span[1] - self.span[0]) / self.middle.size
        return shortest_resolved(information, CELLS) * width

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
        places, sizes, bins = columns.shape
        # one product of two matrices: numpy would compute one for each place
        products = columns.reshape(places * sizes, bins) @ np.column_stack([self.known, self.pull])
        known, score = np.split(products.reshape(places, sizes, -1), [-1], axis=2)
        if self.information.ndim > 1:
            power = np.einsum("mkb,mlb->mkl", columns @ self.information, columns, optimize=True)
        elif columns.shape[1] == 1:
            power = (functions.squares @ self.information)[:, None, None]
        else:
            power = np.einsum("mkb,b,mlb->mkl", columns, self.information, columns, optimize=True)
        own = power - np.einsum("mkp,mlp->mkl", known @ self.covariance, known)
        score = score[..., 0]
        diagonal = np.einsum("mkk->mk", own)
        least = _RARE * functions.largest * float(self.information.sum())
        distinct = (diagonal > np.maximum(UNSEEN * np.einsum("mkk->mk", power), least[:, None])).all(axis=1)
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
