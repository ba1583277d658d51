"""Differences between a recording and its simulations: per step, and along the coordinates of the motion.

The input is a list of steps, each with the measured output and any number of simulated outputs on the same time stamps:
predictions of models, or another recording of the same procedure, aligned by
`benchctl.diagnosis.comparison.pairing`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from benchctl.signals.binning import bin_of
from benchctl_instruments.arrays import FloatArray

_BINS = 24
_BLOCKS = 40
"""Number of block means of a step, which show differences slower than the noise."""

_ORDER = 4
_GAIN = math.sqrt(math.comb(2 * _ORDER, _ORDER))
"""Factor by which differences of that order increase white noise."""

_EXCERPT_S = 8.0
_PERIODS = 6
_EXCERPTS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedStep:
    """One step: arrays of shape (n,) on the time stamps of the measurement; simulated outputs, coordinates by name."""

    name: str
    kind: str
    time_s: FloatArray
    measured_v: FloatArray
    simulated_v: Mapping[str, FloatArray]
    coordinates: Mapping[str, FloatArray]

    def difference(self, name: str) -> FloatArray:
        """Return measured less simulated output, shape (n,)."""
        return self.measured_v - self.simulated_v[name]


@dataclass(frozen=True, slots=True, kw_only=True)
class StepParting:
    """The difference in one step: rms and mean by simulation; `noise_v` is its white part.

    The white part is computed from high-order differences between samples, which slow mismatches do not influence.
    """

    name: str
    kind: str
    t_start: float
    t_end: float
    rms_v: Mapping[str, float]
    mean_v: Mapping[str, float]
    noise_v: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CoordinateParting:
    """Mean difference in bins of a coordinate (m+1 edges, m bins; NaN if a bin is empty), by simulation."""

    coordinate: str
    edges: FloatArray
    count: FloatArray
    mean_v: Mapping[str, FloatArray]
    standard_error_v: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Excerpt:
    """A short part of a step with the largest difference of the first simulation; arrays of shape (n,)."""

    step: str
    time_s: FloatArray
    measured_v: FloatArray
    simulated_v: Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Parting:
    """The differences between a measurement and its simulations; `rms_v` over all samples, by simulation."""

    simulations: tuple[str, ...]
    rms_v: Mapping[str, float]
    noise_v: float
    steps: tuple[StepParting, ...]
    coordinates: tuple[CoordinateParting, ...]
    excerpts: tuple[Excerpt, ...]


def part(steps: Sequence[ComparedStep]) -> Parting:
    """Compare one or more steps; all have the same coordinates and the same simulations, at least one."""
    names = tuple(steps[0].simulated_v)
    summaries = tuple(_of_step(step, names) for step in steps)
    samples = np.array([step.measured_v.size for step in steps], dtype=np.float64)

    def overall(values: Sequence[float]) -> float:
        return math.sqrt(float(np.average(np.square(values), weights=samples)))

    noise = overall([one.noise_v for one in summaries])
    return Parting(
        simulations=names,
        rms_v={name: overall([one.rms_v[name] for one in summaries]) for name in names},
        noise_v=noise,
        steps=summaries,
        coordinates=tuple(_along(steps, names, coordinate, noise) for coordinate in steps[0].coordinates),
        excerpts=tuple(_excerpts(steps, summaries, names[0])),
    )


def _of_step(step: ComparedStep, names: Sequence[str]) -> StepParting:
    differences = {name: step.difference(name) for name in names}
    last = differences[names[-1]]
    return StepParting(
        name=step.name,
        kind=step.kind,
        t_start=float(step.time_s[0]),
        t_end=float(step.time_s[-1]),
        rms_v={name: float(np.sqrt(np.mean(values**2))) for name, values in differences.items()},
        mean_v={name: float(values.mean()) for name, values in differences.items()},
        noise_v=float(np.sqrt(np.mean(np.diff(last, _ORDER) ** 2)) / _GAIN) if last.size > _ORDER else 0.0,
    )


def _along(steps: Sequence[ComparedStep], names: Sequence[str], coordinate: str, noise_v: float) -> CoordinateParting:
    place = np.concatenate([step.coordinates[coordinate] for step in steps])
    known = np.isfinite(place)
    place = place[known]
    low, high = (float(place.min()), float(place.max())) if place.size else (0.0, 0.0)
    edges = np.linspace(low, high if high > low else low + 1.0, _BINS + 1)
    column = bin_of(place, edges)
    count = np.bincount(column, minlength=_BINS).astype(np.float64)

    def means(name: str) -> FloatArray:
        values = np.concatenate([step.difference(name) for step in steps])[known]
        with np.errstate(invalid="ignore"):
            averaged: FloatArray = np.bincount(column, values, _BINS) / count
        return averaged

    with np.errstate(divide="ignore"):
        error = noise_v / np.sqrt(count)
    return CoordinateParting(
        coordinate=coordinate,
        edges=edges,
        count=count,
        mean_v={name: means(name) for name in names},
        standard_error_v=np.where(count > 0, error, np.nan),
    )


def _excerpts(steps: Sequence[ComparedStep], differences: Sequence[StepParting], first: str) -> Iterator[Excerpt]:
    """Yield the excerpts of the steps with the largest differences, one of each kind before a second of any."""
    by_size = sorted(range(len(steps)), key=lambda index: -differences[index].rms_v[first])
    furthest = list({steps[index].kind: index for index in reversed(by_size)}.values())
    others = [index for index in by_size if index not in furthest]
    for index in [*sorted(furthest, key=by_size.index), *others][:_EXCERPTS]:
        step = steps[index]
        window = _furthest_off(step, first)
        yield Excerpt(
            step=step.name,
            time_s=step.time_s[window],
            measured_v=step.measured_v[window],
            simulated_v={name: values[window] for name, values in step.simulated_v.items()},
        )


def _furthest_off(step: ComparedStep, name: str) -> slice:
    """Return the window in which block means of the difference are largest."""
    size = step.time_s.size
    lasts_s = float(step.time_s[-1] - step.time_s[0])
    wanted_s = min(_EXCERPT_S, _PERIODS * _period_s(step.measured_v, lasts_s))
    length = min(size, max(2, int(wanted_s * (size - 1) / max(lasts_s, 1e-9))))
    block = max(1, size // _BLOCKS)
    slow = uniform_filter1d(step.difference(name), block, mode="constant")
    power = np.concatenate([[0.0], np.cumsum(slow**2)])
    start = int(np.argmax(power[length:] - power[:-length]))
    return slice(start, start + length)


def _period_s(output_v: FloatArray, lasts_s: float) -> float:
    """Return the period of an output that is mostly a sine [s]; infinite for any other output."""
    power = np.abs(np.fft.rfft(output_v - output_v.mean())) ** 2
    peak = int(np.argmax(power))
    around = power[max(0, peak - 1) : peak + 2].sum()
    return lasts_s / peak if peak and around > 0.5 * power.sum() else math.inf
