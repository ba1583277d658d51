"""How the uncertainties of what goes into a result become that of the result, in two ways that check each other.

A result is a function of offsets: by how much each quantity that it is computed from differs from what was read. By the
law of propagation of uncertainty (JCGM 100:2008, 5.1 and 5.2) each offset is moved up and down by one standard
uncertainty, one independent direction at a time. By Monte Carlo (JCGM 101:2008) all are drawn at once. Where the two
part, the function is not straight over the offsets, and what was drawn is stated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from benchctl.calibration.result import Contribution
from benchctl.calibration.uncertainty import LEVEL, coverage_factor, effective_dof
from benchctl.metrology.result import Uncertainty
from benchctl.metrology.said import said

FloatArray = npt.NDArray[np.float64]

Offsets = Mapping[str, FloatArray]
"""Of each quantity, by name, shape (d, n): d tries at once."""
Function = Callable[[Offsets], FloatArray]
"""Of each of the tries: the result, shape (d,), or numbers that it is made of, shape (d, n)."""

AGREE = 0.05
"""Up to this part of the expanded uncertainty the two ways are held to agree."""
_DRAWS = 20_000
_SEED = 952


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """What a result depends on: n numbers with the covariance root·rootᵀ, `root` of shape (n, m).

    `uniform`: a rectangle of that standard deviation rather than a bell. `kind` after GUM, 4.2 and 4.3. With finite
    degrees of freedom `dof` the offsets have Student's t distribution (JCGM 101, 6.4.9).
    """

    name: str
    root: FloatArray
    kind: Literal["A", "B"]
    says: str
    uniform: bool = False
    dof: float = math.inf

    def drawn(self, random: np.random.Generator, tries: int) -> FloatArray:
        """Offsets of shape (tries, n)."""
        shape = (tries, self.root.shape[1])
        half = math.sqrt(3.0)
        standard = random.uniform(-half, half, shape) if self.uniform else random.standard_normal(shape)
        if math.isfinite(self.dof):
            standard *= np.sqrt(self.dof / random.chisquare(self.dof, tries))[:, None]
        return np.asarray(standard @ self.root.T)


def single(name: str, standard: float, says: str, *, kind: Literal["A", "B"] = "B", uniform: bool = False) -> Quantity:
    """A quantity of one number."""
    return Quantity(name=name, root=np.array([[standard]]), kind=kind, says=says, uniform=uniform)


def independent(name: str, standard: FloatArray, says: str, *, uniform: bool = False) -> Quantity:
    """Numbers that know nothing of each other, standard uncertainties of shape (n,)."""
    return Quantity(name=name, root=np.diag(standard), kind="B", says=says, uniform=uniform)


def scattered(name: str, covariance: FloatArray, says: str, dof: float = math.inf) -> Quantity:
    """Numbers with a covariance of shape (n, n) that the data themselves tell (type A), with its degrees of freedom."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return Quantity(name=name, root=vectors * np.sqrt(np.maximum(values, 0.0)), kind="A", says=says, dof=dof)


def as_read(function: Function, quantities: Sequence[Quantity]) -> FloatArray:
    """What a function gives without any offset: its one try, without the axis of tries."""
    return np.asarray(function({one.name: np.zeros((1, one.root.shape[0])) for one in quantities})[0])


def largest_of(changes: Function, quantities: Sequence[Quantity]) -> tuple[float, Uncertainty]:
    """The largest size among changes, (d, n) for d tries, and its uncertainty."""
    found = as_read(changes, quantities)
    uncertainty = propagated(
        lambda offsets: np.max(np.abs(changes(offsets)), axis=1),
        quantities,
        null=lambda offsets: np.max(np.abs(changes(offsets) - found), axis=1),
    )
    return float(np.max(np.abs(found))), uncertainty


def deviation_of(values: Function, quantities: Sequence[Quantity]) -> tuple[float, Uncertainty]:
    """The sample standard deviation of values, (d, n) for d tries, and its uncertainty as that of these n."""
    found = as_read(values, quantities)
    uncertainty = propagated(
        lambda offsets: np.std(values(offsets), axis=1, ddof=1),
        quantities,
        null=lambda offsets: np.std(values(offsets) - found, axis=1, ddof=1),
    )
    return float(np.std(found, ddof=1)), uncertainty


def nothing() -> Uncertainty:
    """Of a bound that is what was tried, and no result of a measurement."""
    return Uncertainty(standard=0.0, expanded=0.0, monte_carlo=0.0, contributors=(), says=said("as_tried"))


def propagated(function: Function, quantities: Sequence[Quantity], *, null: Function | None = None) -> Uncertainty:
    """The uncertainty of a result, which is never negative where `null` is given.

    `null` is what the offsets alone would make of the result if there were nothing to be found: the largest of many
    differences, say, is never zero. A value that they make as well is not told from zero, and its uncertainty reaches
    there.
    """
    value = float(as_read(function, quantities))
    contributors = sorted(
        (
            Contribution(
                source=one.name,
                standard=_moved(function, quantities, one),
                kind=one.kind,
                says=one.says,
                dof=one.dof,
            )
            for one in quantities
        ),
        key=lambda part: -part.standard,
    )
    standard = math.sqrt(math.fsum(part.standard**2 for part in contributors))
    dof = effective_dof((part.standard, part.dof) for part in contributors)
    own = [(part.standard, part.dof) for part in contributors if part.kind == "A"]
    type_a = coverage_factor(effective_dof(own)) * math.hypot(*(deviation for deviation, _ in own))
    gum = max(coverage_factor(dof) * standard, type_a)
    random = np.random.default_rng(_SEED)
    offsets = {one.name: one.drawn(random, _DRAWS) for one in quantities}
    tails = np.array([0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)])
    low, high = np.quantile(function(offsets), tails).tolist()
    monte_carlo = 0.5 * (high - low)
    apart = abs(gum - monte_carlo) / monte_carlo if monte_carlo > 0.0 else 0.0
    if apart <= AGREE:
        expanded, says = gum, said("gum_agrees", difference_percent=100.0 * apart)
    else:
        expanded = max(high - value, value - low)
        rectangle = next((one.name for one in quantities if one.uniform and one.name == contributors[0].source), None)
        if rectangle is not None:
            says = said("not_normal", difference_percent=100.0 * apart, source=rectangle)
        else:
            says = said("not_linear" if null is None else "size_of_changes", difference_percent=100.0 * apart)
    if null is not None and value <= float(np.quantile(null(offsets), LEVEL)):
        expanded, says = max(expanded, value), said("not_told_from_zero")
    return Uncertainty(
        standard=standard,
        expanded=expanded,
        dof=dof,
        monte_carlo=monte_carlo,
        contributors=tuple(contributors),
        says=says,
    )


def _moved(function: Function, quantities: Sequence[Quantity], one: Quantity) -> float:
    """What one quantity alone contributes: the root of the sum of squares over its independent directions."""
    directions = one.root.shape[1]
    moved = {other.name: np.zeros((2 * directions, other.root.shape[0])) for other in quantities}
    moved[one.name] = np.concatenate([one.root.T, -one.root.T])
    results = function(moved)
    return float(np.linalg.norm(0.5 * (results[:directions] - results[directions:])))
