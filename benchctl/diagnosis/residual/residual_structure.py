"""The unexplained rest: whether what a fit leaves is noise, and if not, in which coordinate it lives.

No effect is asked: whatever is smooth in a coordinate is followed by broken lines along it, and by how much twice the
log likelihood would gain says how much any effect living there could explain. For the lab's own model, refitted, that
is the ceiling of all that could be explained at all; for the model with the findings, what they fall short of it.

Several coordinates light up for one cause: step, time and temperature go together, output and rate are nearly the same.
The one is taken that explains most with fewest numbers (Schwarz, Annals of Statistics 6, 1978).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from benchctl.diagnosis.residual.events import bump, jump, lines
from benchctl.diagnosis.residual.groups import Group, groups_of
from benchctl.diagnosis.residual.score_test import Columns, ScoreTest, Seen, for_entries
from benchctl.diagnosis.result import COORDINATE_UNITS
from benchctl.estimation.problem import Problem
from benchctl.side_by_side import shared_out
from benchctl.signals.binning import bin_of
from benchctl_instruments.arrays import BoolArray, FloatArray

Whitened = Callable[[Columns], Columns]

CHANCE = 0.003
"""How often noise alone may leave a significant rest, over all coordinates together."""
SHORT = 10.0
"""A finding that brings less than so many times what is left follows it to no better than a third of its size."""
NOISES = ("bias_random_walk", "flicker_noise")
"""Effects that are in the whitener rather than in the prediction."""

_HALF = 0.5
"""What a coordinate must bring in a finding's stead, as a share, for the finding to be doubted at all."""
_OWED = 100.0
"""What is left is owed to the model of a finding that explains so many times more: a tenth of it, in amplitude."""
_AS_GOOD = 0.02
"""Share of the best gain by which another coordinate may fall short and still be named beside it."""
_MOST_NAMED = 3
_CELLS = 24
_MOST_OF_IT = 0.6
_OF_MOTION = frozenset({"rate", "abs_rate", "rate_sign", "acceleration", "angle", "output"})


class Whitens(Protocol):
    """Makes the noise of a column (n,) white; `weight` (n,) is 0 where a row does not count."""

    @property
    def weight(self) -> FloatArray:
        """The inverse of each row's relative deviation."""

    def __call__(self, column: FloatArray) -> FloatArray:
        """The whitened column."""


class Fitted(Protocol):
    """What is used of a fit, with arrays of shape (n,), (n, p) for derivatives, and of the steps for `fitted`."""

    @property
    def predicted(self) -> FloatArray:
        """The model's values."""

    @property
    def residual(self) -> FloatArray:
        """Measured less predicted."""

    @property
    def white(self) -> FloatArray:
        """The same, whitened."""

    @property
    def raw_derivatives(self) -> FloatArray:
        """Those of the prediction by everything that was fitted."""

    @property
    def derivatives(self) -> FloatArray:
        """The same, whitened."""

    @property
    def fitted(self) -> BoolArray:
        """The steps that it was fitted to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Looked:
    """One coordinate that was looked at. `log_p` has the places it was chosen from in it.

    `promise` is the gain less what its numbers are worth by themselves.
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
    """What is left. `gain` is what the best coordinate would bring in twice the log likelihood, with `dof` numbers.

    `log_p` and `threshold` are natural logarithms of chances. `power` is the mean square [whitened unit²] that it would
    explain. `noise_gain` is what slow noise in the whitener brings; `for_noise` says that the best coordinate, with
    white noise, brings as much as that: then the noise is a structure, and all the rest is said of white noise. `event`
    is the line, jump or bump that it is.
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
        """What is left as a share of what could be explained from the baseline alone, 0 to 1."""
        if not self.significant or ceiling.power <= 0.0:
            return 0.0
        return min(self.power / ceiling.power, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Every coordinate looked at in one residual; of the most promising its group, and what was seen of it."""

    looked: tuple[Looked, ...]
    group: Group
    seen: Seen
    rows: float


def residual_structure_of(problem: Problem, whitener: Whitens, fit: Fitted, *, seed: int = 0) -> ResidualStructure:
    """What a fit leaves on the steps that it was fitted to.

    Where the whitener has slow noise in it, white noise with a structure in its stead is looked at first.
    """
    weight = whitener.weight
    rows = fit.fitted[problem.step] & (weight > 0.0)
    white = ScoreTest(fit.white, fit.derivatives, rows)
    if is_plain(whitener, seed):
        return _told(problem, look(white, _groups(problem, fit, white), _weighted(weight)), 0.0)
    plain = ScoreTest(fit.residual * weight, fit.raw_derivatives * weight[:, None], rows)
    noise_gain = plain.freedom * math.log(max(plain.squares, 1e-300) / max(white.squares, 1e-300))
    structure = look(plain, _groups(problem, fit, plain), _weighted(weight))
    if _is_for_noise(structure, plain, whitener, noise_gain):
        return replace(_told(problem, structure, noise_gain), for_noise=True)
    return _told(problem, look(white, _groups(problem, fit, white, slow=True), _through(whitener)), noise_gain)


def residual_structure_beside(problem: Problem, whitener: Whitens, fit: Fitted) -> ResidualStructure:
    """The same beside a disturbance that is known to be there, which the whitener makes white."""
    rows = fit.fitted[problem.step] & (whitener.weight > 0.0)
    white = ScoreTest(fit.white, fit.derivatives, rows)
    return _told(problem, look(white, _groups(problem, fit, white, slow=True), _through(whitener)), 0.0)


def _is_for_noise(structure: View, plain: ScoreTest, whitener: Whitens, noise_gain: float) -> bool:
    """Whether a structure explains as much as slow noise does, and leaves nothing for it."""
    if max(one.promise for one in structure.looked) <= noise_gain:
        return False
    left = plain.without(structure.seen.profile)
    weight = whitener.weight
    unweighted = np.divide(left.white, weight, out=np.zeros_like(left.white), where=weight > 0.0)
    white = whitener(unweighted) * plain.rows
    still = plain.freedom * math.log(max(left.squares, 1e-300) / max(float(white @ white), 1e-300))
    return bool(still < noise_gain / SHORT)


def instead_of(
    problem: Problem, whitener: Whitens, without: Fitted, rest: ResidualStructure, *, seed: int = 0
) -> float:
    """What the coordinate of a rest brings in the place of a finding, less what its numbers are worth.

    `without` is the fit of everything but the finding. A finding that is right brings more than anything smooth in a
    coordinate does in its stead; what the coordinate brings beside the finding as well is not in its stead. Steps do
    not count: what each step does by itself follows almost anything. Of lines, jumps and bumps only the rest's own
    counts: another one, at another place, is nothing that the rest shows.
    """
    rows = without.fitted[problem.step] & (whitener.weight > 0.0)
    left = ScoreTest(without.white, without.derivatives, rows)
    plain = is_plain(whitener, seed)
    whitened = _weighted(whitener.weight) if plain else _through(whitener)
    words = {word for word in rest.coordinates if "step" not in word.split("*")}
    groups = [one for one in _smooth_groups(problem, without, slow=not plain) if words.issuperset(one.words)]
    if rest.event is not None:
        groups.append(rest.event)
    beside = {(one.words, one.form): max(one.promise, 0.0) for one in rest.looked}
    looked = look(left, groups, whitened).looked if groups else ()
    return max((one.promise - beside.get((one.words, one.form), 0.0) for one in looked), default=0.0)


def withdrawn(
    gains: Mapping[str, float], rest: ResidualStructure, instead: Mapping[str, float] | None = None
) -> tuple[str, ...]:
    """Findings that the rest forbids to name; `gains` are in twice the log likelihood, what each alone brings.

    A right model of an effect leaves nearly nothing of what it explains, a wrong one that follows it half leaves much:
    a finding stands where it brings more than `SHORT` times what is left, or where the coordinate itself in its stead
    (`instead`, from `instead_of`) brings not even `_HALF` as much: then what is left is something else, as in every
    real recording. Slow noise is not named where a structure brings as much.
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
    """The ratio of the lack of fit along the motion to pure error, per degree of freedom; at least 1.

    Pure error gains 1 per degree of freedom. If the best function of the motion gains more, a false finding along the
    motion, or the difference of two findings, may gain as much more; so may one `along` a coordinate of its own if a
    function of that one does.
    """
    of_motion = [one for one in rest.looked if one.log_p < rest.threshold and of_the_motion(*one.words)]
    its = [one for one in of_motion if one.words == (along,)]
    return max((one.gain / one.dof for one in (*of_motion[:1], *its)), default=1.0)  # they come in order


def of_the_motion(*coordinates: str) -> bool:
    """Whether coordinates are of the motion alone."""
    return {word for one in coordinates for word in one.split("*")} <= _OF_MOTION


def is_owed(rest: ResidualStructure, gain: float) -> bool:
    """Whether what is left gains so little beside a finding's `gain` that the finding's own model may miss it."""
    return gain >= _OWED * rest.gain


def imperfect(gains: Mapping[str, float], rest: ResidualStructure, instead: Mapping[str, float] | None = None) -> bool:
    """Whether what is left is so little beside what a finding that stands explains that it is owed to its model."""
    standing = set(gains) - set(withdrawn(gains, rest, instead)) - set(NOISES)
    return rest.significant and any(is_owed(rest, gains[name]) for name in standing)


def is_plain(whitener: Whitens, seed: int) -> bool:
    """Whether a whitener only weighs rows, tried on a column of chance."""
    column = np.random.default_rng(seed).standard_normal(whitener.weight.size)
    return bool(np.array_equal(whitener(column), whitener.weight * column))


def look(left: ScoreTest, groups: Iterable[Group], whitened: Whitened) -> View:
    """Look at what is left along every group's coordinate."""

    def look_along(group: Group) -> tuple[Looked, Group, Seen]:
        seen = left.seen(whitened(group.columns()))
        places = math.log(group.places)
        one = Looked(
            words=group.words,
            form=group.form,
            gain=seen.gain,
            promise=seen.gain - seen.dof * math.log(left.freedom) - 2.0 * places,
            dof=seen.dof,
            log_p=min(seen.log_p + places, 0.0),
            inflation=seen.inflation,
        )
        return one, group, seen

    looked: list[Looked] = []
    chosen: tuple[Looked, Group, Seen] | None = None
    for found in shared_out(look_along, groups):
        looked.append(found[0])
        if chosen is None or _rank(found[0]) > _rank(chosen[0]):
            chosen = found
    if chosen is None:
        raise ValueError("nothing to look at: no group of coordinates")
    return View(looked=tuple(looked), group=chosen[1], seen=chosen[2], rows=float(left.rows.sum()))


def threshold_of(looked: int) -> float:
    """The logarithm of the chance below which one of so many coordinates is significant."""
    return math.log(CHANCE / looked)


def _rank(one: Looked) -> tuple[bool, float]:
    # What a single spike explains may be much, and is no structure. Of two that are equal but for the last digits, as a
    # rate and an output without noise are, the first that was looked at is the better: no order of summing decides.
    return one.log_p < math.log(1e-6), float(f"{one.promise:.9g}")


def _smooth_groups(problem: Problem, fit: Fitted, *, slow: bool) -> Iterator[Group]:
    reference_c = problem.circumstances.get("T0_c", 0.0)
    yield from groups_of(problem.coordinates, output=fit.predicted, reference_c=reference_c, slow=slow)


def _groups(problem: Problem, fit: Fitted, left: ScoreTest, *, slow: bool = False) -> Iterator[Group]:
    """All that can be looked at; what happens at one instant only where the noise is white."""
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
    """Whitened columns are no longer sparse: single precision is as much as they need."""

    def whitened(columns: Columns) -> Columns:
        rows, many = columns.shape
        by_column = columns if isinstance(columns, np.ndarray) else columns.tocsc()
        white = np.empty((rows, many), dtype=np.float32, order="F")
        for i in range(many):
            one = by_column[:, i] if isinstance(by_column, np.ndarray) else by_column[:, [i]].toarray()[:, 0]
            white[:, i] = whitener(np.ascontiguousarray(one))
        return white

    return whitened


def _told(problem: Problem, view: View, noise_gain: float) -> ResidualStructure:
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
        power=view.seen.drop / max(view.rows, 1.0),
        noise_gain=noise_gain,
        for_noise=False,
        says=_says(best, named, ranges, problem.unit) if significant else "",
        looked=tuple(sorted(view.looked, key=_rank, reverse=True)),
        event=view.group if view.group.places > 1.0 else None,
    )


def _named(looked: Iterable[Looked], best: Looked) -> tuple[str, ...]:
    """The words of the best coordinate, then of those that explain as much; simple ones first among equals."""
    equals = [one for one in looked if one.promise >= (1.0 - _AS_GOOD) * best.promise and one is not best]
    equals.sort(key=lambda one: ("*" in one.words[0], -one.promise))
    words = dict.fromkeys(word for one in (best, *equals) for word in one.words)
    return tuple(words)[:_MOST_NAMED]


def _ranges(view: View) -> tuple[tuple[float, float], ...]:
    """The shortest range of the coordinate that holds most of what would be explained, where that is a part of it."""
    along = view.group.along
    if along is None:
        return ()
    edges = np.linspace(float(along.min()), float(along.max()), _CELLS + 1)
    held = np.bincount(bin_of(along, edges), view.seen.profile**2, minlength=_CELLS)
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
    beside = f" This recording does not part it from {' or '.join(others)}." if others else ""
    return (
        f"What is left is not noise: it lives in {where}; no known effect accounts for it."
        f" Closest generic form: {best.form}.{beside}"
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
