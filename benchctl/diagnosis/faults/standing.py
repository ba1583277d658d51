"""Runs of exactly equal values, and how unlikely each is if the output follows the prediction.

A sample has code c if prediction and noise are within half a step of it. The product of these probabilities is the
evidence of a run against a working output. The prediction is not yet accurate and the noise unknown, so each run gets
the offset, and each of its rows the deviation, that make it most likely: any offset, and a deviation between that of
the quietest noise and that of the model's error around the run. A prediction that changes by less than its error counts
as constant. The resulting evidence is small at rest on a coarse converter, where equal values are common, and very
large if the gyro was turning.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from benchctl.diagnosis.faults.fault import CHANCE
from benchctl.signals.normal import DEVIATION_OF_MEDIAN
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray

_FEWEST = 3
_BESIDE, _AROUND = 8, 32
"""Rows on either side of a run that are its surroundings: adjacent ones, and the minimum for the wider range."""

_MOST_ROWS = 500
"""Maximum number of rows of a run that are evaluated; of longer runs, evenly spaced ones."""

_DEAD = 0.5

_OFFSETS, _DEVIATIONS = 17, 5
_EXCUSED = 3.0
"""Change of the prediction that is ignored, as a multiple of the model's error around the run."""

_LEAST_DEVIATION = 0.02
"""Minimum deviation in steps, which replaces zero."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Runs:
    """Runs of equal values, rows [first, stop), and the logarithm of their improbability; arrays of shape (m,)."""

    first: IntArray
    stop: IntArray
    evidence: FloatArray

    def where(self, chosen: BoolArray) -> Runs:
        """Return the chosen runs."""
        return Runs(first=self.first[chosen], stop=self.stop[chosen], evidence=self.evidence[chosen])


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """A channel and its properties; arrays of shape (n,).

    `alive` rows are finite and within the rated limit, `stretches` have no gaps, and `foretold` rows are predicted from
    measured values only, not from a filter's extrapolation beyond a gap. `step_v` is the grid's step, `noise_v` the
    quietest noise. A recorder that is faster than the gyro shows each value in `rows_per_value` rows.
    """

    volts: FloatArray
    predicted: FloatArray
    alive: BoolArray
    foretold: BoolArray
    stretches: Sequence[slice]
    step_v: float
    noise_v: float
    rows_per_value: int = 1

    @property
    def enough(self) -> float:
        """The logarithm of improbability that chance exceeds somewhere in the recording once in a thousand cases.

        The improbability of a run counts the rows of a value as if each were new.
        """
        return self.rows_per_value * math.log(self.volts.size / CHANCE)


def standing_runs(output: Output) -> Runs:
    """Return the runs not caused by chance, in order; none if they are most of the recording (a dead channel)."""
    runs = _runs(output)
    surprise = _surprise(runs.stop - runs.first, output.volts.size)
    runs = runs.where(runs.stop - runs.first >= _FEWEST)
    likely = _at_first_sight(output, runs.first, runs.stop)
    runs = runs.where(likely > output.enough)
    evidence = np.array(
        [evidence_of(output, *one) for one in zip(runs.first.tolist(), runs.stop.tolist(), strict=True)]
    )
    evidence = np.minimum(evidence, surprise * (runs.stop - runs.first - 1))
    found = Runs(first=runs.first, stop=runs.stop, evidence=evidence)
    found = found.where(evidence > output.enough)
    dead = float((found.stop - found.first).sum()) > _DEAD * output.volts.size
    return found.where(np.full(found.first.size, not dead))


def evidence_of(output: Output, first: int, stop: int) -> float:
    """Return the logarithm of the improbability that rows [first, stop) all have the value of the first."""
    rows = np.arange(first + 1, stop)
    rows = rows[output.foretold[rows]]
    if rows.size == 0:
        return 0.0
    if rows.size > _MOST_ROWS:
        rows = rows[np.linspace(0, rows.size - 1, _MOST_ROWS).astype(np.int64)]
    low, high = _deviations(output, first, stop)
    predicted = output.predicted[rows]
    least, most = float(predicted.min()), float(predicted.max())
    away = np.abs(predicted[:, None] - np.linspace(least, most, _OFFSETS)[None, :])
    away = np.maximum(away - _EXCUSED * math.sqrt(max(high**2 - low**2 - output.step_v**2 / 12.0, 0.0)), 0.0)
    chances = np.full_like(away, -np.inf)
    for deviation in np.geomspace(low, high, _DEVIATIONS).tolist():
        np.maximum(chances, _log_chance(away, output.step_v, deviation), out=chances)
    return -float(chances.sum(axis=0).max())


def _runs(output: Output) -> Runs:
    volts, alive = output.volts, output.alive
    same = (volts[1:] == volts[:-1]) & alive[1:] & alive[:-1]
    same[[part.start - 1 for part in output.stretches[1:]]] = False
    edges = np.diff(np.concatenate([[0], same.astype(np.int8), [0]]))
    first, stop = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) + 1
    return Runs(first=first, stop=stop, evidence=np.zeros(first.size))


def _surprise(lengths: IntArray, rows: int) -> float:
    """Return the log improbability that a value repeats the previous one, from the number of runs of two.

    If a moving output often repeats by chance, a run of three is not a hold, whatever noise the model predicts.
    """
    pairs = max(int(np.count_nonzero(lengths == _FEWEST - 1)), 1)
    return math.log(rows / pairs)


def _at_first_sight(output: Output, first: IntArray, stop: IntArray) -> FloatArray:
    """Return the evidence with the mid prediction as offset and the quietest noise: an upper limit of the full one."""
    if first.size == 0:
        return np.zeros(0)
    bounds = np.column_stack([first + 1, stop]).ravel()
    padded = np.append(output.predicted, 0.0)
    most = np.maximum.reduceat(padded, bounds)[::2]
    least = np.minimum.reduceat(padded, bounds)[::2]
    lengths = stop - first - 1
    begins = np.cumsum(lengths) - lengths
    rows = np.arange(int(lengths.sum())) + np.repeat(first + 1 - begins, lengths)
    away = np.abs(output.predicted[rows] - np.repeat((most + least) / 2.0, lengths))
    chances = _log_chance(away, output.step_v, _least(output))
    return -np.add.reduceat(chances, begins)


def _least(output: Output) -> float:
    return max(output.noise_v, _LEAST_DEVIATION * output.step_v)


def _deviations(output: Output, first: int, stop: int) -> tuple[float, float]:
    """Return the smallest and the largest deviation that the output around a run allows [V].

    If a limit acts before the noise, the model is wrong only while the output is limited; so rows adjacent to the run
    are evaluated separately from the wider surroundings.
    """
    least = _least(output)
    reaches = (_BESIDE, max(stop - first, _AROUND))
    return least, max(least, *(_error(output, first, stop, reach) for reach in reaches))


def _error(output: Output, first: int, stop: int, reach: int) -> float:
    """Return the model's error within `reach` rows on either side of a run [V]."""
    middles, spreads = [], []
    for side in (slice(max(first + 1 - reach, 0), first + 1), slice(stop, stop + reach)):
        around = (output.volts[side] - output.predicted[side])[output.alive[side]]
        if around.size == 0:
            continue
        middles.append(float(np.median(around)))
        spreads.append(DEVIATION_OF_MEDIAN * float(np.median(np.abs(around - middles[-1]))))
    return max(*spreads, max(middles) - min(middles)) if middles else 0.0


def _log_chance(away: FloatArray, step: float, deviation: float) -> FloatArray:
    """Return the log probability of a normal value within half a step of a code `away` from its mean."""
    near = log_ndtr(-(away - step / 2.0) / deviation)
    far = log_ndtr(-(away + step / 2.0) / deviation)
    chance: FloatArray = near + np.log1p(-np.exp(np.minimum(far - near, -1e-12)))
    return chance
