"""A fault of the data, as found: what it is, how large, how sure, and which rows it spoils."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from benchctl.diagnosis.result import Estimate, Where
from benchctl_instruments.arrays import BoolArray

CHANCE = 1e-3
"""How often a kind of fault may be found, anywhere in a recording, where there is none."""

_MOST_GAIN = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A data fault in the words of the vocabulary of effects (`effect` and the names of `parameters`).

    `rows` (n,) are spoilt and must not count. `gain` is the evidence in twice the log likelihood, `says` the finding in
    one sentence; it is seen along `coordinate`, and at `where`, where that is known better than by the rows.
    """

    effect: str
    parameters: Mapping[str, Estimate]
    rows: BoolArray
    gain: float
    says: str
    coordinate: str = "time"
    where: Where | None = None

    def on_rows(self, rows: BoolArray) -> Fault:
        """The same fault where what it spoils are other rows, means over several readings say."""
        return replace(self, rows=rows)


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundFaults:
    """What a search found.

    `masked` (n,) holds the rows of all that is `found`, and those that are spoilt without being a finding. In the
    `standing` ones among them (n,) the output tells nothing at all: they are held, or at a rail. `step_v` is the step
    that the values come in, 0 where none shows.
    """

    found: tuple[Fault, ...]
    masked: BoolArray
    standing: BoolArray
    step_v: float


def bounded_gain(log_likelihood_ratio: float) -> float:
    """Twice a log likelihood ratio, as the finite number that a report can print."""
    return float(np.clip(2.0 * log_likelihood_ratio, 0.0, _MOST_GAIN))
