"""Noise whose standard deviation depends on a coordinate, modelled by the simplest shape.

The noise is estimated from differences of neighbouring rows, which are not affected by slow model errors. Each row
belongs to one difference only, so the differences are independent. Their squares are summed once over bins of the
coordinate; the gain in likelihood of any function is then a sum over bins.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize

from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.result import Estimate
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.structures.scan import coordinates_of
from benchctl.estimation.fit import fit, inverse
from benchctl.signals.binning import bin_of
from benchctl.signals.normal import Z95
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.physics.structure_places import OVER, Span
from benchctl_instruments.physics.structures import Structure, structure

_BINS = 400
_FEWEST = 2000
_COORDINATES = ("gyro_temp", "time", "gyro_temp_rate", "setpoint", "angle")
_SIZES = np.geomspace(0.02, 8.0, 14)
_LEAST = 0.04
"""Minimum relative change of the noise: smaller changes come from converter rounding or from encoder noise."""
_SHORTEST = 0.1
"""Minimum length of a plateau relative to the range: a shorter one may be the noise of a single step."""
_CHANCE_GAIN = 30.0
_NORMAL_KURTOSIS = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseFound:
    """A structure of the noise: its parameters with intervals, and the share of the noise power that it explains."""

    structure: Structure
    estimates: Mapping[str, Estimate]
    explains: float


@dataclass(frozen=True, kw_only=True)
class _Binned:
    """Bin centres of a coordinate, sums of squared differences and numbers of differences per bin; (b,) each."""

    middle: FloatArray
    squares: FloatArray
    count: FloatArray

    def deviance(self, factor: FloatArray) -> FloatArray:
        """Return minus twice the log likelihood of noise scaled by `factor` in each bin, shape (…, b)."""
        power = factor**2
        total = float(self.count.sum())
        level = np.sum(self.squares / power, axis=-1) / total
        return np.asarray(np.sum(self.count * np.log(power), axis=-1) + total * np.log(np.maximum(level, 1e-300)))

    def gain(self, effect: Structure) -> float:
        """Return the increase of twice the log likelihood by a structure."""
        factor = 1.0 + effect.value_at(self.middle)
        if (factor <= 0.0).any():
            return -math.inf
        return float(self.deviance(np.ones_like(self.middle)) - self.deviance(factor))


def noise_structure(problem: GyroProblem, chosen: Selection) -> NoiseFound | None:
    """Return the structure of the noise; None if the noise is constant or depends only on the rate."""
    if problem.band is not None:
        return None
    first, half, odd = _differences(problem, chosen)
    if first.size < _FEWEST:
        return None
    held = chosen.heldout[problem.step[first]]
    coordinates = coordinates_of(problem, chosen.after)
    tried: list[tuple[float, Structure, int]] = []
    places = 0
    for over in (one for one in _COORDINATES if one in coordinates):
        values = coordinates[over][first]
        span = float(values.min()), float(values.max())
        if not span[0] < span[1]:
            continue
        fitted = _binned(values[~held], half[~held], span)
        for shape, grid in _grids(over, span):
            places += len(grid) * _SIZES.size
            begun = _best_of(fitted, over, shape, grid, span)
            one = None if begun is None else _refined(fitted, begun)
            if one is None:
                continue
            gain = fitted.gain(one) / odd
            if held.any() and _binned(values[held], half[held], span).gain(one) < 0.0:
                continue
            if _everywhere(problem, values, half, first, span, one):
                tried.append((gain - len(one.parameters) * math.log(first.size), one, len(one.parameters)))
    looked = 2.0 * math.log(max(places, 1))
    evidence, best, _ = max(tried, key=lambda one: one[0], default=(-math.inf, None, 0))
    if best is None or evidence < looked + _CHANCE_GAIN:
        return None
    values = coordinates[best.over][first]
    factor = 1.0 + best.value_at(values)
    if float(factor.max() / factor.min()) < 1.0 + _LEAST:
        return None
    span = float(values.min()), float(values.max())
    binned = _binned(values, half, span)
    best = _refined(binned, best) or best
    power = float(np.mean((1.0 + best.value_at(values)) ** 2))
    return NoiseFound(structure=best, estimates=_estimates(binned, best, odd), explains=1.0 - 1.0 / max(power, 1.0))


def with_noise(problem: GyroProblem, chosen: Selection, found: NoiseFound) -> Selection:
    """Return the selection refitted with rows weighted by the noise structure.

    Rate-dependent noise stays in the noise model if it is still significant in addition to the structure.
    """
    relative = 1.0 + found.structure.value_at(coordinates_of(problem, chosen.after)[found.structure.over])
    more = relative**2 - 1.0

    def weighed(weight: FloatArray) -> FloatArray:
        relative = np.divide(1.0, weight, out=np.ones_like(weight), where=weight > 0.0)
        return np.asarray(np.where(weight > 0.0, 1.0 / np.sqrt(relative**2 + more), 0.0))

    noise = chosen.noise.simplified(problem, chosen.after, relative, least_gain=chosen.least)
    whitener = replace(noise.whitener, weight=weighed(noise.whitener.weight))
    plain = replace(noise.plain, weight=weighed(noise.plain.weight))
    noise = replace(noise, whitener=whitener, plain=plain)

    before = fit(problem, plain, chosen.before.point, chosen.before.fitted)
    after, full = (fit(problem, whitener, one.point, one.fitted) for one in (chosen.after, chosen.full))
    named = None if chosen.named is None else fit(problem, whitener, chosen.named.point, chosen.named.fitted)
    return replace(
        chosen, noise=noise, before=before.light, after=after, full=full, named=named, noise_structure=found.structure
    )


def _differences(problem: GyroProblem, chosen: Selection) -> tuple[IntArray, FloatArray, float]:
    """Return the first rows of independent neighbouring pairs and half their squared differences, shape (m,) each.

    The squares are divided by the known relative increase of their variance. The third value is the excess scatter of
    the squares relative to normal noise, at least 1.
    """
    weight = chosen.noise.plain.weight
    counted = weight > 0.0
    first = 2 * np.arange(problem.step.size // 2)
    first = first[counted[first] & counted[first + 1] & (problem.step[first] == problem.step[first + 1])]
    level2 = max(chosen.noise.level, 1e-300) ** 2
    _, step = problem.regressor_variance
    grown = 1.0 + step[first] / level2
    growing = chosen.noise.found.get("noise_rate_dependent")
    if growing is not None:
        share = problem.coordinates["rate"][first] / problem.circumstances["range_dps"]
        grown = grown + growing.size * share**2
    residual = chosen.after.residual
    half = 0.5 * (residual[first + 1] - residual[first]) ** 2 / grown
    if not first.size:
        return first, half, 1.0
    kurtosis = float(np.mean(half**2)) / max(float(np.mean(half)) ** 2, 1e-300)
    return first, half, max((kurtosis - 1.0) / (_NORMAL_KURTOSIS - 1.0), 1.0)


def _binned(values: FloatArray, half: FloatArray, span: Span) -> _Binned:
    edges = np.linspace(*span, _BINS + 1)
    bins = bin_of(np.clip(values, *span), edges)
    squares, count = (np.bincount(bins, one, minlength=_BINS).astype(np.float64) for one in (half, np.ones_like(half)))
    filled = count > 0.0
    return _Binned(middle=(0.5 * (edges[:-1] + edges[1:]))[filled], squares=squares[filled], count=count[filled])


def _grids(over: str, span: Span) -> Iterator[tuple[str, list[dict[str, float]]]]:
    """Yield shapes for the growth of noise, with their places."""
    if OVER[over].directions is not None:
        for shape in ("negative", "positive", "either"):
            yield shape, [{}]
        return
    low, wide = span[0], span[1] - span[0]
    ats = [low + wide * share for share in np.linspace(0.02, 0.98, 33).tolist()]
    yield "step", [{"at": at, "width": 0.01 * wide} for at in ats]
    yield "step_below", [{"at": at, "width": 0.01 * wide} for at in ats]
    yield "kink", [{"at": at} for at in ats[:-3]]
    yield "kink_below", [{"at": at} for at in ats[3:]]
    yield "bump", [{"at": at, "width": share * wide} for at in ats for share in (0.05, 0.15)]
    yield (
        "plateau",
        [{"at": at, "length": until - at} for at in ats[::2] for until in ats[::2] if until > at + _SHORTEST * wide],
    )


def _unit_of(shape: str) -> tuple[str, float]:
    """Return the name of a shape's size, and the sign that increases the noise."""
    return {"kink": ("above", 1.0), "kink_below": ("below", -1.0)}.get(shape, ("change", 1.0))


def _best_of(
    binned: _Binned, over: str, shape: str, grid: Sequence[Mapping[str, float]], span: Span
) -> Structure | None:
    """Return the structure with the best place and the best size on a grid; None if no place covers any data."""
    kind = structure("noise", over, shape, span)
    name, sign = _unit_of(shape)
    columns = np.array([kind.make({**place, name: sign}).value_at(binned.middle) for place in grid])
    largest = columns.max(axis=1)
    active = largest > 0.0
    if not active.any():
        return None
    columns = columns[active] / largest[active, None]
    deviance = binned.deviance(1.0 + columns[:, None, :] * _SIZES[None, :, None])
    place, size = np.unravel_index(int(np.argmin(deviance)), deviance.shape)
    kept = [one for one, is_active in zip(grid, active.tolist(), strict=True) if is_active]
    return kind.make({**kept[int(place)], name: sign * float(_SIZES[int(size)] / largest[active][int(place)])})


def _refined(binned: _Binned, begun: Structure) -> Structure | None:
    """Return the structure with the parameters maximising the likelihood near the start, within the bounds."""
    names = list(begun.parameters)
    unit = np.array([_scale(begun, name) for name in names])

    def at(place: FloatArray) -> Structure | None:
        values = {name: float(value) for name, value in zip(names, place * unit, strict=True)}
        inside = all(one.low < values[name] < one.high for name, one in begun.parameters.items())
        return type(begun).make(values) if inside else None

    def cost(place: FloatArray) -> float:
        one = at(place)
        return 1e12 if one is None else -binned.gain(one)

    start = np.array([begun.values[name] for name in names]) / unit
    found = scipy.optimize.minimize(
        cost, start, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 0.02, "maxfev": 400}
    )
    one = at(found.x)
    return one if one is not None and binned.gain(one) >= binned.gain(begun) else begun


def _scale(effect: Structure, name: str) -> float:
    """Return the initial step of a parameter: its own value for sizes and lengths, a share of the range for places."""
    parameter = effect.parameters[name]
    if parameter.logarithmic or parameter.role == "size":
        return max(abs(effect.values[name]), 1e-12)
    return 0.05 * (parameter.high - parameter.low)


def _everywhere(
    problem: GyroProblem, values: FloatArray, half: FloatArray, first: IntArray, span: Span, effect: Structure
) -> bool:
    """Return whether the structure holds at rest, in motion, in odd and in even steps, if they have enough rows."""
    rate = np.abs(problem.coordinates["rate"][first])
    resting = rate < 0.01 * problem.range_dps
    odd = problem.step[first] % 2 == 1
    for rows in (resting, ~resting, odd, ~odd):
        factor = 1.0 + effect.value_at(values[rows]) if rows.any() else np.ones(1)
        if np.count_nonzero(rows) < _FEWEST or float(factor.max() / factor.min()) < 1.0 + _LEAST:
            continue
        if _binned(values[rows], half[rows], span).gain(effect) < 0.0:
            return False
    return True


def _estimates(binned: _Binned, effect: Structure, odd: float) -> dict[str, Estimate]:
    """Return the parameters with their intervals, from the curvature of the likelihood."""
    names = list(effect.parameters)
    nudges = np.array([0.05 * _scale(effect, name) for name in names])
    place = np.array([effect.values[name] for name in names])

    def gain(moves: FloatArray) -> float:
        return binned.gain(type(effect).make(dict(zip(names, (place + moves * nudges).tolist(), strict=True))))

    size = len(names)
    unit = np.eye(size)
    bend = np.zeros((size, size))
    for i in range(size):
        for j in range(i + 1):
            bend[i, j] = bend[j, i] = 0.25 * (
                gain(unit[i] + unit[j]) - gain(unit[i] - unit[j]) - gain(unit[j] - unit[i]) + gain(-unit[i] - unit[j])
            )
    information = -0.5 * np.where(np.isfinite(bend), bend, 0.0) / odd
    variance = np.maximum(np.diag(inverse(information)), 0.0)
    halves = Z95 * np.sqrt(variance) * nudges
    return {
        name: Estimate(value=value, low=value - error, high=value + error, unit=effect.parameters[name].unit)
        for name, value, error in zip(names, place.tolist(), halves.tolist(), strict=True)
    }
