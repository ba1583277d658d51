"""What a table of static points cannot show: structure that the table itself may have made.

Nobody measured the rates of static points. What they are wrong by repeats with every visit, so that scatter does not
show it, and it looks like a nonlinearity or an asymmetry of the gyro.
"""

from __future__ import annotations

import numpy as np

from benchctl.diagnosis.gyro.points import PointsProblem
from benchctl.diagnosis.search.select import reduced, without
from benchctl.diagnosis.search.selection import Selection
from benchctl.estimation.fit import Fit
from benchctl.estimation.problem import Problem


def owed_to_the_table(problem: Problem, largest_v: float) -> bool:
    """Whether a change of the output is no more than what commanded rates may be wrong by."""
    return isinstance(problem, PointsProblem) and largest_v < problem.rate_error_v


def without_the_tables_own(problem: Problem, chosen: Selection) -> tuple[Selection, tuple[str, ...]]:
    """The selection without effects that the table itself may have made, the smallest first, and what is to be noted.

    Of other parts, and of recordings with an encoder, everything stays.
    """
    if not isinstance(problem, PointsProblem):
        return chosen, ()
    dropped: list[str] = []
    while chosen.evidence:
        changes = {key: _change_v(chosen.after, without(problem, chosen, key)) for key in chosen.evidence}
        smallest = min(changes, key=lambda key: changes[key])
        if not owed_to_the_table(problem, changes[smallest]):
            break
        dropped.append(smallest.replace("_", " "))
        chosen = reduced(problem, chosen, {smallest})
    if not dropped:
        return chosen, ()
    return chosen, (
        f"The points also follow a {' and a '.join(dropped)}, by less than commanded rates may be wrong by:"
        f" {problem.rate_error_v:.2g} {problem.unit}, 0.1 % of the largest. That may be the table's own and is not"
        " named; an encoder would tell.",
    )


def _change_v(one: Fit, other: Fit) -> float:
    """By how much two fits differ at most, on rows that count."""
    counted = one.whitener.weight > 0.0
    return float(np.abs(one.predicted - other.predicted)[counted].max())
