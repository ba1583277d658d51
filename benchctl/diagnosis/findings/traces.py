"""Short excerpts for the plot: where the models before and after differ most, and where samples are spoilt."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from benchctl.diagnosis.faults import Fault
from benchctl.diagnosis.findings.located import left_of
from benchctl.diagnosis.result import Trace
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.stepped import PartProblem
from benchctl_instruments.arrays import FloatArray

_LASTS_S = 3.0
_FEWEST, _MOST = 60, 600
_SHORTEST = 20
"""Length of an excerpt in rows: longer for slow samples, shorter for fast ones; shorter steps are not shown."""
_COUNT = 3
_WORTH = 0.1
"""Share of the largest difference that one in a held-out step, or of another kind, needs to be preferred."""


@dataclass(frozen=True, slots=True)
class _Window:
    score: float
    rows: slice
    step: int


def traces_of(problem: PartProblem, chosen: Selection, faults: Sequence[Fault] = ()) -> tuple[Trace, ...]:
    """Return up to three excerpts, preferably from steps of different kinds and from held-out steps.

    One shows the spoilt rows of each kind of `faults`; the others are where before and after differ most or, if no
    finding changes the prediction, where the residual is largest. A wandering bias is followed from sample to sample:
    `after` is then the prediction of each sample from those before it.
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
    """Return whether any finding changes the prediction."""
    return bool(chosen.after.point.effects or chosen.noise.found)


def _by_score(one: _Window) -> float:
    return -one.score


def _chosen(problem: PartProblem, chosen: Selection, windows: list[_Window], count: int) -> list[_Window]:
    """Return the best windows, held-out steps first; a second one of a kind counts only `_WORTH` of its score."""
    least = _WORTH * max((one.score for one in windows), default=0.0)
    held = [one for one in windows if chosen.heldout[one.step] and one.score > least]
    remaining = held or windows
    picked: list[_Window] = []
    while remaining and len(picked) < count:
        kinds = {problem.step_kinds[one.step] for one in picked}
        best = max(remaining, key=lambda one: one.score * (_WORTH if problem.step_kinds[one.step] in kinds else 1.0))
        picked.append(best)
        remaining = [one for one in remaining if one is not best]
    return picked


def _windows(problem: PartProblem, score: FloatArray, *, edges: bool = False) -> Iterator[_Window]:
    """Yield each step's window of rows with the largest sum of a score (n,), if any row of the step scores.

    With `edges`, a window in which every row scores is excluded.
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
