"""A fault of the data: its kind, its size, the evidence for it, and the rows that it spoils."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from benchctl.diagnosis.result import Estimate, Where
from benchctl_instruments.arrays import BoolArray

CHANCE = 1e-3
"""Probability that a kind of fault is found somewhere in a recording that has none."""

_MOST_GAIN = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A data fault, with `effect` and the names of `parameters` from the vocabulary of effects.

    `rows` (n,) are spoilt and must not be used. `gain` is the evidence in twice the log likelihood, `says` the finding
    in one sentence. It is located along `coordinate`, and at `where` if that is more precise than the rows.
    """

    effect: str
    parameters: Mapping[str, Estimate]
    rows: BoolArray
    gain: float
    says: str
    coordinate: str = "time"
    where: Where | None = None

    def on_rows(self, rows: BoolArray) -> Fault:
        """Return the same fault with other spoilt rows, such as means over several readings."""
        return replace(self, rows=rows)


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundFaults:
    """The result of a search for faults.

    `masked` (n,) are the rows of all `found` faults and rows that are spoilt without being a finding. In the `standing`
    rows (n,) among them, held or at a rail, the output contains no information. `step_v` is the step of the values, 0
    if none is visible. Each value is repeated in `rows_per_value` rows, of which the first is used.
    """

    found: tuple[Fault, ...]
    masked: BoolArray
    standing: BoolArray
    step_v: float
    rows_per_value: int = 1


def bounded_gain(log_likelihood_ratio: float) -> float:
    """Return twice a log likelihood ratio, limited to a finite number that a report can print."""
    return float(np.clip(2.0 * log_likelihood_ratio, 0.0, _MOST_GAIN))
