"""Short excerpts for the picture: where the models before and after differ most, and where samples are spoilt."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from benchctl.diagnosis.faults import Fault
from benchctl.diagnosis.findings.located import left_of
from benchctl.diagnosis.result import Trace
from benchctl.diagnosis.search.selection import Selection
from benchctl.estimation.problem import Problem
from benchctl_instruments.arrays import FloatArray

_LASTS_S = 3.0
_FEWEST, _MOST = 60, 600
_SHORTEST = 20
"""Rows of an excerpt: of slow samples more time is shown, of fast ones less; a step with fewer rows tells nothing."""
_COUNT = 3
_WORTH = 0.1
"""Share of the largest difference that one in a held-out step, or of another kind, must reach to be shown instead."""


@dataclass(frozen=True, slots=True)
class _Window:
    score: float
    rows: slice
    step: int


def traces_of(problem: Problem, chosen: Selection, faults: Sequence[Fault] = ()) -> tuple[Trace, ...]:
    """Up to three excerpts, of different kinds of steps where that tells enough, of held-out steps where these do.

    One shows the spoilt rows of each kind of `faults`; the others where before and after differ most or, where nothing
    was found that changes a prediction, where most is left. A wandering bias is followed from sample to sample:
    `after` is then what was predicted of each from those before.
    """
    before = problem.measured - chosen.before.residual
    after = problem.measured - left_of(problem, chosen.after, chosen.whitener)
    differs = (after - before) ** 2 if _changed(chosen) else chosen.after.residual**2
    windows: list[_Window] = []
    for fault in faults:
        windows += sorted(_windows(problem, fault.rows.astype(np.float64), edges=True), key=_by_score)[:1]
    windows = windows[: _COUNT - 1]
    windows += _chosen(problem, chosen, list(_windows(problem, differs * problem.usable)), _COUNT - len(windows))
    return tuple(
        Trace(
            step=problem.step_names[one.step],
            heldout=bool(chosen.heldout[one.step]),
            time_s=problem.time_s[one.rows],
            measured=problem.measured[one.rows],
            before=before[one.rows],
            after=after[one.rows],
            spoilt=~problem.usable[one.rows],
        )
        for one in windows
    )


def _changed(chosen: Selection) -> bool:
    """Whether something was found that changes what is predicted."""
    return bool(chosen.after.point.effects or chosen.noise.found)


def _by_score(one: _Window) -> float:
    return -one.score


def _chosen(problem: Problem, chosen: Selection, windows: list[_Window], count: int) -> list[_Window]:
    """The best of them, those of held-out steps first; a further one of a kind counts only as much as `_WORTH`."""
    least = _WORTH * max((one.score for one in windows), default=0.0)
    held = [one for one in windows if chosen.heldout[one.step] and one.score > least]
    left = held or windows
    picked: list[_Window] = []
    while left and len(picked) < count:
        kinds = {problem.step_kinds[one.step] for one in picked}
        best = max(left, key=lambda one: one.score * (_WORTH if problem.step_kinds[one.step] in kinds else 1.0))
        picked.append(best)
        left = [one for one in left if one is not best]
    return picked


def _windows(problem: Problem, score: FloatArray, *, edges: bool = False) -> Iterator[_Window]:
    """Of every step the stretch of rows with the largest sum of a score (n,); with `edges` not one that is full of it.

    A step in which nothing scores has none.
    """
    usual = min(max(round(_LASTS_S / problem.interval_s), _FEWEST), _MOST)
    bounds = np.searchsorted(problem.step, np.arange(len(problem.step_names) + 1)).tolist()
    total = np.concatenate([[0.0], np.cumsum(score)])
    for step, (first, stop) in enumerate(pairwise(bounds)):
        length = min(usual, stop - first)
        if length < _SHORTEST:
            continue
        starts = np.arange(first, stop - length + 1)
        sums = total[starts + length] - total[starts]
        if edges:
            sums *= length - sums
        lasts = problem.time_s[starts + length - 1] - problem.time_s[starts]
        sums[lasts > (length - 0.5) * problem.interval_s] = 0.0
        best = int(np.argmax(sums))
        if sums[best] > 0.0:
            yield _Window(float(sums[best]), slice(first + best, first + best + length), step)
