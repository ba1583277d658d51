"""One figure beside a peer's or a limit's, both measured in the same run: what every benchmark answers with."""

from __future__ import annotations

import operator
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

Sense = Literal["<=", ">="]
SENSES: dict[Sense, Callable[[float, float], bool]] = {"<=": operator.le, ">=": operator.ge}


@dataclass(frozen=True, slots=True)
class Comparison:
    """Ours and theirs in one unit. The goal is one of the ratio, ours over theirs: `sense` "<=" and 1.5, say.

    Where the limit is a bare number (5 µs, 500 MiB), `against` says so and the goal is "<=" 1.
    """

    name: str
    value: float
    unit: str
    against: str
    against_value: float
    sense: Sense
    bound: float

    @property
    def ratio(self) -> float:
        """Ours over theirs."""
        return self.value / self.against_value

    @property
    def reached(self) -> bool:
        """Whether the goal is reached."""
        return SENSES[self.sense](self.ratio, self.bound)

    def as_json(self) -> dict[str, object]:
        """What `--json` holds of it."""
        return {
            "name": self.name,
            "value": self.value,
            "unit": self.unit,
            "against": self.against,
            "against_value": self.against_value,
            "ratio": self.ratio,
            "goal": f"{self.sense} {self.bound:g}",
            "reached": self.reached,
        }


def alternating(ours: Callable[[], float], theirs: Callable[[], float], turns: int) -> tuple[float, float]:
    """The medians of two measurements taken in turns, so that a busy moment of the machine falls on both."""
    pairs: Sequence[tuple[float, float]] = [(ours(), theirs()) for _ in range(turns)]
    return statistics.median(one for one, _ in pairs), statistics.median(other for _, other in pairs)
