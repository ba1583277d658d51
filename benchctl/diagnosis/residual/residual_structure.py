"""The residual structure: whether the residual of a fit is noise, and if not, in which coordinate it occurs.

The test uses no known effects: broken lines along a coordinate follow anything smooth in it, and their gain in twice
the log likelihood shows how much any effect along it could explain. For the refitted lab model this is the ceiling of
all that could be explained; for the model with the findings it is what they fail to explain.

One cause is visible in several coordinates: step, time and temperature vary together, output and rate are nearly equal.
The coordinate is chosen that explains most with the fewest parameters (Schwarz, Annals of Statistics 6, 1978).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Protocol
from weakref import WeakKeyDictionary

import numpy as np

from benchctl.diagnosis.residual.events import bump, jump, lines
from benchctl.diagnosis.residual.groups import Group, groups_of
from benchctl.diagnosis.residual.score_test import Columns, Score, ScoreTest, for_entries
from benchctl.diagnosis.result import COORDINATE_UNITS
from benchctl.diagnosis.stepped import PartProblem
from benchctl.side_by_side import shared_out
from benchctl.signals.binning import bin_of
from benchctl_instruments.arrays import BoolArray, FloatArray

Whitened = Callable[[Columns], Columns]

CHANCE = 0.003
"""Probability that noise alone leaves a significant structure, for all coordinates together."""
SHORT = 10.0
"""Minimum ratio of a finding's gain to that of the residual; below it, more than a third of its amplitude is left."""
NOISES = ("bias_random_walk", "flicker_noise")
"""Effects that are modelled in the whitener and not in the prediction."""

_HALF = 0.5
"""Minimum share of a finding's gain that a coordinate must reach in its place for the finding to be doubted."""
_ATTRIBUTABLE = 100.0
"""The residual is attributed to a finding's model if the finding explains so much more: ten times in amplitude."""
_AS_GOOD = 0.02
"""Maximum relative deficit in gain for another coordinate to be named together with the best."""
_MOST_NAMED = 3
_CELLS = 24
_MOST_OF_IT = 0.6
_OF_MOTION = frozenset({"rate", "abs_rate", "rate_sign", "acceleration", "angle", "output"})


class Whitens(Protocol):
    """A filter that makes the noise of a column (n,) white; `weight` (n,) is 0 for rows that do not count."""

    @property
    def weight(self) -> FloatArray:
        """The inverse of each row's relative noise deviation."""

    def __call__(self, column: FloatArray) -> FloatArray:
        """Return the whitened column."""


class Fitted(Protocol):
    """The attributes of a fit used here; arrays of shape (n,), derivatives (n, p), `fitted` one value per step."""

    @property
    def predicted(self) -> FloatArray:
        """The predicted values."""

    @property
    def residual(self) -> FloatArray:
        """Measured less predicted values."""

    @property
    def white(self) -> FloatArray:
        """The whitened residual."""

    @property
    def raw_derivatives(self) -> FloatArray:
        """Derivatives of the prediction by all fitted parameters."""

    @property
    def derivatives(self) -> FloatArray:
        """The whitened derivatives."""

    @property
    def fitted(self) -> BoolArray:
        """The steps that the model was fitted to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Looked:
    """The result for one tested coordinate. `log_p` accounts for the number of places it was selected from.

    `promise` is the gain less the penalty for its parameters.
    """

    words: tuple[str, ...]
    form: str
    gain: float
    promise: float
    dof: int
    log_p: float
    inflation: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualStructure:
    """The structure of a residual. `gain` is that of the best coordinate, `dof` the number of parameters it needs.

    Gains are in twice the log likelihood, `log_p` and `threshold` natural logarithms of probabilities. `power` is the
    mean square [whitened unit²] that the coordinate would explain. `noise_gain` is the gain of slow noise in the
    whitener; if `for_noise`, the best coordinate gains as much with white noise, the slow noise is a structure, and all
    other fields refer to white noise. `event` is the line, jump or bump, if the structure is one.
    """

    significant: bool
    gain: float
    dof: int
    log_p: float
    threshold: float
    coordinates: tuple[str, ...]
    form: str
    ranges: tuple[tuple[float, float], ...]
    power: float
    noise_gain: float
    for_noise: bool
    says: str
    looked: tuple[Looked, ...]
    event: Group | None = None

    def share_of(self, ceiling: ResidualStructure) -> float:
        """Return the residual structure as a share of what could be explained of the baseline's residual, 0 to 1."""
        if not self.significant or ceiling.power <= 0.0:
            return 0.0
        return min(self.power / ceiling.power, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """The results for all coordinates of one residual, with the group and the score of the most promising one."""

    looked: tuple[Looked, ...]
    group: Group
    score: Score
    rows: float


_KNOWN: WeakKeyDictionary[Fitted, tuple[Whitens, int, ResidualStructure]] = WeakKeyDictionary()


def residual_structure_of(problem: PartProblem, whitener: Whitens, fit: Fitted, *, seed: int = 0) -> ResidualStructure:
    """Return the structure of a fit's residual on the steps that it was fitted to.

    If the whitener contains slow noise, a structure with white noise is tested first in its place. The last result for
    a fit is kept as long as the fit, because several passes of a diagnosis ask for it.
    """
    known = _KNOWN.get(fit)
    if known is not None and known[0] is whitener and known[1] == seed:
        return known[2]
    found = _residual_structure_of(problem, whitener, fit, seed)
    _KNOWN[fit] = whitener, seed, found
    return found


def _residual_structure_of(problem: PartProblem, whitener: Whitens, fit: Fitted, seed: int) -> ResidualStructure:
    weight = whitener.weight
    rows = fit.fitted[problem.step] & (weight > 0.0)
    white = ScoreTest(fit.white, fit.derivatives, rows)
    if is_plain(whitener, seed):
        return _described(problem, look(white, _groups(problem, fit, white), _weighted(weight)), 0.0)
    plain = ScoreTest(fit.residual * weight, fit.raw_derivatives * weight[:, None], rows)
    noise_gain = plain.freedom * math.log(max(plain.squares, 1e-300) / max(white.squares, 1e-300))
    structure = look(plain, _groups(problem, fit, plain), _weighted(weight))
    if _is_for_noise(structure, plain, whitener, noise_gain):
        return replace(_described(problem, structure, noise_gain), for_noise=True)
    return _described(problem, look(white, _groups(problem, fit, white, slow=True), _through(whitener)), noise_gain)


def residual_structure_with_disturbance(problem: PartProblem, whitener: Whitens, fit: Fitted) -> ResidualStructure:
    """Return the residual structure in addition to a known disturbance, which the whitener makes white."""
    rows = fit.fitted[problem.step] & (whitener.weight > 0.0)
    white = ScoreTest(fit.white, fit.derivatives, rows)
    return _described(problem, look(white, _groups(problem, fit, white, slow=True), _through(whitener)), 0.0)


def _is_for_noise(structure: View, plain: ScoreTest, whitener: Whitens, noise_gain: float) -> bool:
    """Return whether a structure explains as much as slow noise and leaves nothing for it to explain."""
    if max(one.promise for one in structure.looked) <= noise_gain:
        return False
    left = plain.without(structure.score.profile)
    weight = whitener.weight
    unweighted = np.divide(left.white, weight, out=np.zeros_like(left.white), where=weight > 0.0)
    white = whitener(unweighted) * plain.rows
    still = plain.freedom * math.log(max(left.squares, 1e-300) / max(float(white @ white), 1e-300))
    return bool(still < noise_gain / SHORT)


def instead_of(
    problem: PartProblem, whitener: Whitens, without: Fitted, rest: ResidualStructure, *, seed: int = 0
) -> float:
    """Return what the coordinates of a residual structure gain in place of a finding, less the parameter penalty.

    `without` is the fit without the finding. A correct finding gains more than anything smooth in a coordinate does in
    its place; the coordinate's gain with the finding in the model is subtracted. Steps are not used, because a separate
    value for each step follows almost anything. Of lines, jumps and bumps only the event of `rest` is used, as another
    event at another place is not part of this residual.
    """
    rows = without.fitted[problem.step] & (whitener.weight > 0.0)
    left = ScoreTest(without.white, without.derivatives, rows)
    plain = is_plain(whitener, seed)
    whitened = _weighted(whitener.weight) if plain else _through(whitener)
    words = {word for word in rest.coordinates if "step" not in word.split("*")}
    groups = [one for one in _smooth_groups(problem, without, slow=not plain) if words.issuperset(one.words)]
    if rest.event is not None:
        groups.append(rest.event)
    with_finding = {(one.words, one.form): max(one.promise, 0.0) for one in rest.looked}
    looked = look(left, groups, whitened).looked if groups else ()
    return max((one.promise - with_finding.get((one.words, one.form), 0.0) for one in looked), default=0.0)


def withdrawn(
    gains: Mapping[str, float], rest: ResidualStructure, instead: Mapping[str, float] | None = None
) -> tuple[str, ...]:
    """Return the findings that the residual structure forbids; `gains` in twice the log likelihood are per finding.

    A correct model of an effect leaves almost nothing of what it explains; a wrong one that follows half of it leaves
    much. A finding is kept if its gain exceeds `SHORT` times that of the residual, or if the coordinate in its place
    (`instead`, from `instead_of`) gains less than `_HALF` as much: then the residual has another cause, as in every
    real recording. Slow noise is withdrawn if a structure gains as much.
    """
    if not rest.significant:
        return ()
    held = instead or {}

    def falls(name: str, gain: float) -> bool:
        if name in NOISES and rest.for_noise:
            return True
        in_its_stead = held.get(name, gain)
        if in_its_stead < _HALF * gain:
            return False
        return gain < SHORT * rest.gain

    return tuple(name for name, gain in gains.items() if falls(name, gain))


def lack_of_fit(rest: ResidualStructure, along: str = "") -> float:
    """Return the ratio of the lack of fit along the motion to pure error, per degree of freedom; at least 1.

    Pure error gains 1 per degree of freedom. If the best function of the motion gains more, a false finding along the
    motion, or the difference of two findings, may gain that much more; the same holds for a finding whose own
    coordinate is `along` if a function of that coordinate gains more.
    """
    of_motion = [one for one in rest.looked if one.log_p < rest.threshold and of_the_motion(*one.words)]
    its = [one for one in of_motion if one.words == (along,)]
    return max((one.gain / one.dof for one in (*of_motion[:1], *its)), default=1.0)  # sorted, best first


def of_the_motion(*coordinates: str) -> bool:
    """Return whether all coordinates belong to the motion."""
    return {word for one in coordinates for word in one.split("*")} <= _OF_MOTION


def is_attributable(rest: ResidualStructure, gain: float) -> bool:
    """Return whether the residual gains so little relative to `gain` that a finding's model may have caused it."""
    return gain >= _ATTRIBUTABLE * rest.gain


def imperfect(gains: Mapping[str, float], rest: ResidualStructure, instead: Mapping[str, float] | None = None) -> bool:
    """Return whether the residual is small enough to be attributed to the model of a finding that is kept."""
    standing = set(gains) - set(withdrawn(gains, rest, instead)) - set(NOISES)
    return rest.significant and any(is_attributable(rest, gains[name]) for name in standing)


def is_plain(whitener: Whitens, seed: int) -> bool:
    """Return whether a whitener only weights rows, tested on a random column."""
    column = np.random.default_rng(seed).standard_normal(whitener.weight.size)
    return bool(np.array_equal(whitener(column), whitener.weight * column))


def look(left: ScoreTest, groups: Iterable[Group], whitened: Whitened) -> View:
    """Test the residual along every group's coordinate."""

    def look_along(group: Group) -> tuple[Looked, Group, Score]:
        score = left.score(whitened(group.columns()))
        places = math.log(group.places)
        one = Looked(
            words=group.words,
            form=group.form,
            gain=score.gain,
            promise=score.gain - score.dof * math.log(left.freedom) - 2.0 * places,
            dof=score.dof,
            log_p=min(score.log_p + places, 0.0),
            inflation=score.inflation,
        )
        return one, group, score

    looked: list[Looked] = []
    chosen: tuple[Looked, Group, Score] | None = None
    for found in shared_out(look_along, groups):
        looked.append(found[0])
        if chosen is None or _rank(found[0]) > _rank(chosen[0]):
            chosen = found
    if chosen is None:
        raise ValueError("nothing to look at: no group of coordinates")
    return View(looked=tuple(looked), group=chosen[1], score=chosen[2], rows=float(left.rows.sum()))


def threshold_of(looked: int) -> float:
    """Return the logarithm of the probability below which one of so many coordinates is significant."""
    return math.log(CHANCE / looked)


def _rank(one: Looked) -> tuple[bool, float]:
    # A single spike may explain much and is no structure. Of two equal up to the last digits, such as rate and output
    # without noise, the first tested is taken, so that the order of summation does not decide.
    return one.log_p < math.log(1e-6), float(f"{one.promise:.9g}")


def _smooth_groups(problem: PartProblem, fit: Fitted, *, slow: bool) -> Iterator[Group]:
    reference_c = problem.circumstances.get("T0_c", 0.0)
    yield from groups_of(problem.coordinates, output=fit.predicted, reference_c=reference_c, slow=slow)


def _groups(problem: PartProblem, fit: Fitted, left: ScoreTest, *, slow: bool = False) -> Iterator[Group]:
    """Yield all groups to test; events at one instant only if the noise is white."""
    time_s = problem.time_s
    yield from _smooth_groups(problem, fit, slow=slow)
    yield from lines(left, time_s, problem.interval_s, problem.step)
    if not slow:
        yield jump(left, time_s)
        yield bump(left, time_s, problem.interval_s)


def _weighted(weight: FloatArray) -> Whitened:
    def whitened(columns: Columns) -> Columns:
        if isinstance(columns, np.ndarray):
            columns *= weight[:, None]
            return columns
        columns.data *= for_entries(columns, weight)
        return columns

    return whitened


def _through(whitener: Whitens) -> Whitened:
    """Return a function that whitens columns; whitened columns are dense, so single precision saves memory."""

    def whitened(columns: Columns) -> Columns:
        rows, many = columns.shape
        by_column = columns if isinstance(columns, np.ndarray) else columns.tocsc()
        white = np.empty((rows, many), dtype=np.float32, order="F")
        for i in range(many):
            one = by_column[:, i] if isinstance(by_column, np.ndarray) else by_column[:, [i]].toarray()[:, 0]
            white[:, i] = whitener(np.ascontiguousarray(one))
        return white

    return whitened


def _described(problem: PartProblem, view: View, noise_gain: float) -> ResidualStructure:
    threshold = threshold_of(len(view.looked))
    best = max(view.looked, key=_rank)
    significant = best.log_p < threshold
    named = _named(view.looked, best) if significant else ()
    ranges = _ranges(view) if significant else ()
    return ResidualStructure(
        significant=significant,
        gain=best.gain,
        dof=best.dof,
        log_p=best.log_p,
        threshold=threshold,
        coordinates=named,
        form=best.form,
        ranges=ranges,
        power=view.score.drop / max(view.rows, 1.0),
        noise_gain=noise_gain,
        for_noise=False,
        says=_says(best, named, ranges, problem.unit) if significant else "",
        looked=tuple(sorted(view.looked, key=_rank, reverse=True)),
        event=view.group if view.group.places > 1.0 else None,
    )


def _named(looked: Iterable[Looked], best: Looked) -> tuple[str, ...]:
    """Return the words of the best coordinate, then of those with equal gain, simple ones first."""
    equals = [one for one in looked if one.promise >= (1.0 - _AS_GOOD) * best.promise and one is not best]
    equals.sort(key=lambda one: ("*" in one.words[0], -one.promise))
    words = dict.fromkeys(word for one in (best, *equals) for word in one.words)
    return tuple(words)[:_MOST_NAMED]


def _ranges(view: View) -> tuple[tuple[float, float], ...]:
    """Return the shortest range of the coordinate with most of the explained power, if it is only a part; else ()."""
    along = view.group.along
    if along is None:
        return ()
    edges = np.linspace(float(along.min()), float(along.max()), _CELLS + 1)
    held = np.bincount(bin_of(along, edges), view.score.profile**2, minlength=_CELLS)
    sums = np.concatenate([[0.0], np.cumsum(held)]) / max(float(held.sum()), 1e-300)
    for length in range(1, _CELLS // 2 + 1):
        shares = sums[length:] - sums[:-length]
        first = int(np.argmax(shares))
        if shares[first] >= _MOST_OF_IT:
            return ((float(edges[first]), float(edges[first + length])),)
    return ()


def _says(best: Looked, named: tuple[str, ...], ranges: tuple[tuple[float, float], ...], unit: str) -> str:
    where = _phrase(best.words[0])
    if ranges:
        words = best.words[0].split("*")
        word = next((one for one in words if one != "rate"), words[0])
        low, high = ranges[0]
        unit = unit if word == "output" else COORDINATE_UNITS.get(word, "")
        where += f", most at {low:.3g} to {high:.3g} {unit}".rstrip()
    others = [_phrase(word) for word in named if word not in best.words]
    sentence = f" This recording does not separate it from {' or '.join(others)}." if others else ""
    return (
        f"The residual is not noise: it depends on {where}; no known effect accounts for it."
        f" Closest generic form: {best.form}.{sentence}"
    )


_PHRASES = {
    "time": "time",
    "rate": "the rate",
    "abs_rate": "the size of the rate",
    "rate_sign": "the direction of rotation",
    "acceleration": "the acceleration",
    "angle": "the table's angle",
    "gyro_temp": "the gyro's temperature",
    "gyro_temp_rate": "the rate of the gyro's temperature",
    "chamber_temp": "the chamber's temperature",
    "output": "the output",
    "frequency": "one frequency",
    "step": "the steps",
}


def _phrase(word: str) -> str:
    return " together with ".join(_PHRASES.get(one, one) for one in word.split("*"))
