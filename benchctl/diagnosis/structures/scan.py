"""Where the search for a shape over a coordinate begins: all places of all shapes at once, by the residual's pull.

A structure is a function of one coordinate, times the volts of the rate where it acts on the scale factor. So the pull
of the residual is summed over narrow bins of the coordinate once, and what any function would gain is a product of
sums.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.fitting.fit import inverse
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.search.pull import Pull
from benchctl.diagnosis.signals.bins import bin_of
from benchctl_instruments.physics.structures import SHAPES, Span, Structure, StructureStage, structure

FloatArray = npt.NDArray[np.float64]

_BINS = 1000
_PLACES, _EDGES = 60, 40
_UNSEEN, _RARE = 1e-7, 1e-9
"""Shares of its own power, and of that at its largest everywhere, that a shape must have beside what was fitted."""
_WIDTHS = (0.01, 0.03, 0.1)
_BUMPS = (0.01, 0.025, 0.06, 0.15)
_PERIODS = np.geomspace(0.03, 2.0, 80)
_SETTLING = np.geomspace(0.01, 1.0, 12)


@dataclass(frozen=True, slots=True, kw_only=True)
class Begun:
    """The best place of a shape: the structure there, what it promises to gain, and out of how many places it is."""

    effect: Structure
    gain: float
    places: int


def places_along(problem: GyroProblem, pull: Pull, stage: StructureStage, over: str) -> Iterator[Begun]:
    """The best place of each shape over a coordinate; of those that promise anything."""
    along = _Along.of(problem, pull, stage, over)
    if along is None:
        return
    for shape in SHAPES:
        kind = structure(stage, over, shape, along.span)
        sizes = [name for name, parameter in kind.parameters.items() if parameter.role == "size"]
        best, count = None, 0
        for place in _grid(over, shape, along.span):
            count += 1
            unit = dict.fromkeys(sizes, 0.0) | dict(place)
            columns = np.stack([kind.make({**unit, name: 1.0}).value_at(along.middle) for name in sizes])
            gain, weights = along.gain(columns)
            if best is None or gain > best[0]:
                best = gain, {**unit, **dict(zip(sizes, weights.tolist(), strict=True))}
        if best is not None and best[0] > 0.0:
            yield Begun(effect=kind.make(best[1]), gain=best[0], places=count)


@dataclass(frozen=True, kw_only=True)
class _Along:
    """The pull of a residual summed over bins of a coordinate, whose middles are `middle` (b,).

    `pull` and `information` (b,) are sums of the rows' own, `known` (b, p) of the pull of the fit's derivatives.
    """

    middle: FloatArray
    pull: FloatArray
    information: FloatArray
    known: FloatArray
    covariance: FloatArray
    span: Span

    @classmethod
    def of(cls, problem: GyroProblem, pull: Pull, stage: StructureStage, over: str) -> _Along | None:
        values = _clock_s(problem) if over == "time" else problem.coordinates[over]
        rows = pull.rows
        span = float(values[rows].min()), float(values[rows].max())
        if not span[0] < span[1]:
            return None
        fitted = pull.fitted
        factor = fitted.predicted - fitted.point.baseline[1] if stage == "scale" else np.ones_like(values)
        edges = np.linspace(*span, _BINS + 1)
        bins = bin_of(np.clip(values, *span), edges)

        def summed(of: FloatArray) -> FloatArray:
            return np.asarray(np.bincount(bins, of, minlength=_BINS))

        return cls(
            middle=0.5 * (edges[:-1] + edges[1:]),
            pull=summed(pull.pull * factor),
            information=summed(pull.information * factor**2),
            known=np.stack([summed(pull.of_known(i) * factor) for i in range(len(fitted.numbers))], axis=1),
            covariance=fitted.inverse_information,
            span=span,
        )

    def gain(self, columns: FloatArray) -> tuple[float, FloatArray]:
        """What functions of the coordinate (k, b) promise together, and how much of each is best, shape (k,)."""
        known = columns @ self.known
        power = (columns * self.information) @ columns.T
        own = power - known @ self.covariance @ known.T
        largest = np.abs(columns).max(axis=1) ** 2 * float(self.information.sum())
        if (np.diag(own) <= np.maximum(_UNSEEN * np.diag(power), _RARE * largest)).any():
            return 0.0, np.zeros(len(columns))
        score = columns @ self.pull
        weights = inverse(own) @ score
        return float(weights @ score), weights


def _clock_s(problem: GyroProblem) -> FloatArray:
    """Time as effects count it: from the beginning of the recording that a stretch belongs to, shape (n,)."""
    clock = problem.time_s.copy()
    for part, origin_s in zip(problem.stretches, problem.frame.origins_s, strict=True):
        clock[part] -= origin_s
    return clock


def _grid(over: str, shape: str, span: Span) -> Iterator[Mapping[str, float]]:
    """Places that cover the range of a coordinate."""
    low, wide = span[0], span[1] - span[0]

    def ats(count: int) -> list[float]:
        return [low + wide * (i + 1) / (count + 1) for i in range(count)]

    if shape == "step":
        yield from ({"at": at, "width": width * wide} for at in ats(_PLACES) for width in _WIDTHS)
    elif shape in ("kink", "kink_below", "bend"):
        yield from ({"at": at} for at in ats(_PLACES))
    elif shape == "bump":
        yield from ({"at": at, "width": width * wide} for at in ats(_PLACES) for width in _BUMPS)
    elif shape == "plateau":
        edges = ats(_EDGES)
        yield from ({"at": at, "length": until - at} for at in edges for until in edges if until > at)
    elif shape == "wave":
        turns = [360.0 / order for order in range(1, 25)]
        yield from ({"period": period} for period in (turns if over == "angle" else (wide * _PERIODS).tolist()))
    elif shape == "exponential":
        if over == "time":
            yield from ({"tau": share * wide} for share in _SETTLING.tolist())
    else:
        yield {}
