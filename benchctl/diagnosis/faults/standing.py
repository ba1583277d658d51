"""Runs of exactly equal values, and how unlikely each is if the output went on as the model predicts.

A sample falls on code c if prediction and noise lie within half a step of it. A run is evidence against a living output
by the product of these probabilities. The prediction is not yet right and the noise not known, so each run is given the
offset, and each of its rows the deviation, that excuse it best: an offset of any size, a deviation from that of the
quietest noise to that of the model's error around the run. Where the prediction moves by no more than it is wrong by,
it counts as at rest. What is left is small at rest on a coarse converter, where equal values are the rule, and enormous
wherever the gyro turned on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from benchctl.diagnosis.faults.fault import CHANCE
from benchctl.signals.normal import DEVIATION_OF_MEDIAN
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray

_FEWEST = 3
_BESIDE, _AROUND = 8, 32
"""Rows on either side from which a run's surroundings are judged: right beside it, and as many at least."""

_MOST_ROWS = 500
"""Rows of a run that are weighed; of a longer one so many, evenly."""

_DEAD = 0.5

_OFFSETS, _DEVIATIONS = 17, 5
_EXCUSED = 3.0
"""By how many times the model's error around a run the prediction may have moved without counting."""

_LEAST_DEVIATION = 0.02
"""In steps: what a deviation of zero is replaced by."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Runs:
    """Rows [first, stop) with one value each, and the log of how unlikely that is; arrays of shape (m,)."""

    first: IntArray
    stop: IntArray
    evidence: FloatArray

    def where(self, chosen: BoolArray) -> Runs:
        """Some of them."""
        return Runs(first=self.first[chosen], stop=self.stop[chosen], evidence=self.evidence[chosen])


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """A channel with what is known of it; arrays of shape (n,).

    `alive` rows are numbers within the rated limit, `broken` ones follow a gap, and of `foretold` ones the prediction
    is made of what was measured, not of what a filter took to be beyond a gap. `step_v` is the grid's step, `noise_v`
    the quietest noise.
    """

    volts: FloatArray
    predicted: FloatArray
    alive: BoolArray
    foretold: BoolArray
    broken: BoolArray
    step_v: float
    noise_v: float

    @property
    def enough(self) -> float:
        """The log of improbability that chance reaches somewhere in the recording one time in a thousand."""
        return math.log(self.volts.size / CHANCE)


def standing_runs(output: Output) -> Runs:
    """The runs that chance does not make, in order; none where they are most of the recording: the channel is dead."""
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
    """How unlikely it is, as a log, that rows [first, stop) would all have had the value of the first."""
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
    same = (volts[1:] == volts[:-1]) & alive[1:] & alive[:-1] & ~output.broken[1:]
    edges = np.diff(np.concatenate([[0], same.astype(np.int8), [0]]))
    first, stop = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) + 1
    return Runs(first=first, stop=stop, evidence=np.zeros(first.size))


def _surprise(lengths: IntArray, rows: int) -> float:
    """How unlikely it is, as a log, that a value repeats the one before it: by how many are met just once more.

    Where a moving output often does so by chance, three of a kind are no hold, whatever the model says of its noise.
    """
    pairs = max(int(np.count_nonzero(lengths == _FEWEST - 1)), 1)
    return math.log(rows / pairs)


def _at_first_sight(output: Output, first: IntArray, stop: IntArray) -> FloatArray:
    """Evidence with the middle of the prediction as offset and the quietest noise: never less than the full one."""
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
    """The least and the largest deviation that the output around a run allows [V].

    Where a limit comes before the noise, the model is wrong for as short as the output is limited: right beside a run
    counts as well as farther around it.
    """
    least = _least(output)
    reaches = (_BESIDE, max(stop - first, _AROUND))
    return least, max(least, *(_error(output, first, stop, reach) for reach in reaches))


def _error(output: Output, first: int, stop: int, reach: int) -> float:
    """The model's error within `reach` rows on either side of a run [V]."""
    middles, spreads = [], []
    for side in (slice(max(first + 1 - reach, 0), first + 1), slice(stop, stop + reach)):
        around = (output.volts[side] - output.predicted[side])[output.alive[side]]
        if around.size == 0:
            continue
        middles.append(float(np.median(around)))
        spreads.append(DEVIATION_OF_MEDIAN * float(np.median(np.abs(around - middles[-1]))))
    return max(*spreads, max(middles) - min(middles)) if middles else 0.0


def _log_chance(away: FloatArray, step: float, deviation: float) -> FloatArray:
    """Log of the chance that a normal value falls within half a step of a code that its mean is `away` from."""
    near = log_ndtr(-(away - step / 2.0) / deviation)
    far = log_ndtr(-(away + step / 2.0) / deviation)
    chance: FloatArray = near + np.log1p(-np.exp(np.minimum(far - near, -1e-12)))
    return chance
