"""What a recording conceals."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from tests.benchctl.diagnosis.foreign.benches import BENCHES, Bench
from tests.benchctl.diagnosis.foreign.plans import SET_POINTS

Effects = dict[str, dict[str, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """What a recording conceals, and where it was made.

    `effects` are in the words of the vocabulary. `outsiders` are effects that it does not have, each with its numbers;
    `lives_in` says in which coordinates. `bench` and `plan` number the bench and the plan.
    """

    kind: str
    bench: int
    plan: int
    effects: Effects = field(default_factory=dict)
    coefficients_moved: bool = False
    outsiders: Effects = field(default_factory=dict)
    lives_in: tuple[str, ...] = ()

    @property
    def where(self) -> Bench:
        """The bench."""
        return BENCHES[self.bench]

    @property
    def set_points(self) -> tuple[float, ...]:
        """The chamber's set points (°C)."""
        return SET_POINTS[self.plan]

    @property
    def lacking(self) -> frozenset[str]:
        """The terms that the file's simulation lacks."""
        terms = {"rate_nonlinearity": "k_omega", "scale_temperature": "k_T"}
        return frozenset(term for effect, term in terms.items() if effect in self.effects)

    def as_json(self) -> dict[str, Any]:
        """As `truth.json` says it."""
        said: dict[str, Any] = {"effects": self.effects, "coefficients_moved": self.coefficients_moved}
        if self.outsiders:
            said |= {"outsiders": self.outsiders, "coordinates": list(self.lives_in)}
        return said
