"""Confusion matrix of drawn and stated effects."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchctl.proof.trial import Answer, Trial

NOTHING, UNKNOWN, WITHHELD, ADDED = "nothing", "unknown structure", "hypothesis withheld", "in addition to others"
"""Rows and columns that are no effects. The row `ADDED` counts false positives of trials without a missed effect."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Confusion:
    """Counts, shape (rows, columns): a row per drawn effect, a column per stated one.

    A missed effect counts in the columns of all false positives of its trial; if there are none, under `UNKNOWN` or
    `NOTHING`.
    """

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    counts: npt.NDArray[np.int64]

    def is_right(self, row: int, column: int) -> bool:
        """Return whether the answers counted in this cell are right."""
        drawn, stated = self.rows[row], self.columns[column]
        return stated == (UNKNOWN if drawn == WITHHELD else drawn)

    def as_json(self) -> dict[str, object]:
        """Return the matrix as JSON data."""
        return {"drawn": list(self.rows), "stated": list(self.columns), "counts": self.counts.tolist()}


def confusion(trials: Sequence[Trial], answer: Callable[[Trial], Answer | None]) -> Confusion:
    """Return the confusion matrix of one arm; trials without an answer are left out."""
    pairs: Counter[tuple[str, str]] = Counter()
    for trial in trials:
        if (found := answer(trial)) is not None and found.score is not None:
            pairs.update(_pairs(trial, found))
    drawn, stated = ({pair[i] for pair in pairs} for i in range(2))
    effects = sorted((drawn | stated) - {NOTHING, UNKNOWN, WITHHELD, ADDED})
    rows = (*effects, *(name for name in (NOTHING, WITHHELD, ADDED) if name in drawn))
    columns = (*effects, *(name for name in (NOTHING, UNKNOWN) if name in stated))
    counts = np.array([[pairs[row, column] for column in columns] for row in rows], dtype=np.int64)
    return Confusion(rows=rows, columns=columns, counts=counts.reshape(len(rows), len(columns)))


def _pairs(trial: Trial, found: Answer) -> list[tuple[str, str]]:
    stated = set(found.stated)
    if trial.truth["withheld"]:
        return [(WITHHELD, name) for name in stated or {UNKNOWN if found.unexplained else NOTHING}]
    drawn = set(trial.drawn)
    missed, made_up = drawn - stated, stated - drawn
    pairs = [(name, name) for name in drawn & stated]
    instead = made_up or {UNKNOWN if found.unexplained else NOTHING}
    if not drawn:
        return [(NOTHING, name) for name in instead]
    if missed:
        return pairs + [(name, other) for name in missed for other in instead]
    return pairs + [(ADDED, name) for name in made_up]
