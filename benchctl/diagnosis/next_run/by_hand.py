"""The next run of what no procedure plays: a drive, a chamber, a table of points. What to do is said in words."""

from __future__ import annotations

from collections.abc import Sequence

from benchctl.diagnosis.drive.problem import DriveProblem
from benchctl.diagnosis.next_run.experiment import NOTHING_OPEN
from benchctl.diagnosis.result import Finding, NextExperiment, Unexplained
from benchctl.estimation.problem import Problem

_TOGETHER = "and diagnose both recordings together"


def next_by_hand(problem: Problem, findings: Sequence[Finding], unexplained: Unexplained) -> NextExperiment:
    """The run that parts the findings from their alternatives, or that shows more of what is unexplained."""
    open_ones = [one for one in findings if one.alternatives]
    names = tuple(dict.fromkeys(name for one in open_ones for name in (one.effect, one.alternatives[0].effect)))
    if isinstance(problem, DriveProblem) and problem.turns_one_way and (findings or unexplained.significant):
        cannot = f", which cannot separate {' from '.join(names)}" if names else ""
        return NextExperiment(
            says=f"The table turned one way only{cannot}: run it in the other direction of rotation, {_TOGETHER}.",
            separates=names,
        )
    if names:
        wanted = "; ".join(dict.fromkeys(problem.effects[name].excited_by for name in names if name in problem.effects))
        return NextExperiment(
            says=f"This recording does not separate {' from '.join(names)}: record {wanted}, {_TOGETHER}.",
            separates=names,
        )
    if unexplained.significant:
        along = " and ".join(unexplained.coordinates) or "no single coordinate"
        how = "for longer" if along == "time" else "over a wider range of it where possible"
        return NextExperiment(
            says=f"The unexplained part depends on {along}: record once more, {how}, {_TOGETHER}; what repeats belongs"
            " to the bench."
        )
    return NOTHING_OPEN
