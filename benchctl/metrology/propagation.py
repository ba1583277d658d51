"""Propagate the uncertainties of input quantities to a result, by two methods that check each other.

A result is a function of offsets: the differences of the quantities from their readings. By the law of propagation of
uncertainty (JCGM 100:2008, 5.1 and 5.2) each offset is moved up and down by one standard uncertainty, one independent
direction at a time. By Monte Carlo (JCGM 101:2008) all are drawn at once. If the two differ, the function is not linear
over the offsets, and the result of Monte Carlo is reported.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchctl.calibration.result import Contribution
from benchctl.calibration.uncertainty import LEVEL, coverage_factor, effective_dof
from benchctl.metrology.result import Uncertainty, message
from benchctl_instruments.arrays import FloatArray

Offsets = Mapping[str, FloatArray]
"""Offsets of each quantity, by name, shape (d, n): d draws at once."""
Function = Callable[[Offsets], FloatArray]
"""Maps draws to the result, shape (d,), or to its components, shape (d, n)."""

AGREE = 0.05
"""Relative difference of the expanded uncertainties up to which the two methods agree."""
_DRAWS = 20_000
_SEED = 952


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """An input of a result: n numbers with the covariance root·rootᵀ, `root` of shape (n, m).

    `uniform`: a rectangular instead of a normal distribution of that standard deviation. `kind` after GUM, 4.2 and 4.3.
    With finite degrees of freedom `dof` the offsets have Student's t distribution (JCGM 101, 6.4.9).
    """

    name: str
    root: FloatArray
    kind: Literal["A", "B"]
    note: str
    uniform: bool = False
    dof: float = math.inf

    def drawn(self, random: np.random.Generator, tries: int) -> FloatArray:
        """Draw offsets of shape (tries, n)."""
        shape = (tries, self.root.shape[1])
        half = math.sqrt(3.0)
        standard = random.uniform(-half, half, shape) if self.uniform else random.standard_normal(shape)
        if math.isfinite(self.dof):
            standard *= np.sqrt(self.dof / random.chisquare(self.dof, tries))[:, None]
        return np.asarray(standard @ self.root.T)


def single(name: str, standard: float, note: str, *, kind: Literal["A", "B"] = "B", uniform: bool = False) -> Quantity:
    """Return a quantity of one number."""
    return Quantity(name=name, root=np.array([[standard]]), kind=kind, note=note, uniform=uniform)


def independent(name: str, standard: FloatArray, note: str, *, uniform: bool = False) -> Quantity:
    """Return a quantity of independent numbers with standard uncertainties of shape (n,)."""
    return Quantity(name=name, root=np.diag(standard), kind="B", note=note, uniform=uniform)


def scattered(name: str, covariance: FloatArray, note: str, dof: float = math.inf) -> Quantity:
    """Return numbers with a covariance (n, n) estimated from the data (type A), and its degrees of freedom."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return Quantity(name=name, root=vectors * np.sqrt(np.maximum(values, 0.0)), kind="A", note=note, dof=dof)


def as_read(function: Function, quantities: Sequence[Quantity]) -> FloatArray:
    """Evaluate a function with zero offsets; the result has no axis of draws."""
    return np.asarray(function({one.name: np.zeros((1, one.root.shape[0])) for one in quantities})[0])


def standards(function: Function, quantities: Sequence[Quantity]) -> FloatArray:
    """Return the standard uncertainty of each component of a result (d, n), by the law of propagation; (n,)."""
    parts = [_moved(function, quantities, one) for one in quantities]
    return np.asarray(np.linalg.norm(np.concatenate(parts), axis=0))


def largest_of(changes: Function, quantities: Sequence[Quantity]) -> tuple[float, Uncertainty]:
    """Return the largest magnitude among changes, (d, n) for d draws, and its uncertainty."""
    found = as_read(changes, quantities)
    uncertainty = propagated(
        lambda offsets: np.max(np.abs(changes(offsets)), axis=1),
        quantities,
        null=lambda offsets: np.max(np.abs(changes(offsets) - found), axis=1),
    )
    return float(np.max(np.abs(found))), uncertainty


def deviation_of(values: Function, quantities: Sequence[Quantity]) -> tuple[float, Uncertainty]:
    """Return the sample standard deviation of values, (d, n) for d draws, and its uncertainty for these n."""
    found = as_read(values, quantities)
    uncertainty = propagated(
        lambda offsets: np.std(values(offsets), axis=1, ddof=1),
        quantities,
        null=lambda offsets: np.std(values(offsets) - found, axis=1, ddof=1),
    )
    return float(np.std(found, ddof=1)), uncertainty


def nothing() -> Uncertainty:
    """Return the uncertainty of a bound that is a tried value, not a measured one."""
    return Uncertainty(standard=0.0, expanded=0.0, monte_carlo=0.0, contributors=(), says=message("as_tried"))


def propagated(function: Function, quantities: Sequence[Quantity], *, null: Function | None = None) -> Uncertainty:
    """Return the uncertainty of a result, which is never negative if `null` is given.

    `null` gives the result of the offsets alone for a true value of zero: the largest of many differences, for example,
    is never zero. A value within the range of `null` is not distinguishable from zero, and its uncertainty includes
    zero.
    """
    value = float(as_read(function, quantities))
    contributors = sorted(
        (
            Contribution(
                source=one.name,
                standard=float(np.linalg.norm(_moved(function, quantities, one))),
                kind=one.kind,
                says=one.note,
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
        expanded, explanation = gum, message("gum_agrees", difference_percent=100.0 * apart)
    else:
        expanded = max(high - value, value - low)
        rectangle = next((one.name for one in quantities if one.uniform and one.name == contributors[0].source), None)
        if rectangle is not None:
            explanation = message("not_normal", difference_percent=100.0 * apart, source=rectangle)
        else:
            explanation = message("not_linear" if null is None else "size_of_changes", difference_percent=100.0 * apart)
    if null is not None and value <= float(np.quantile(null(offsets), LEVEL)):
        expanded, explanation = max(expanded, value), message("not_told_from_zero")
    return Uncertainty(
        standard=standard,
        expanded=expanded,
        dof=dof,
        monte_carlo=monte_carlo,
        contributors=tuple(contributors),
        says=explanation,
    )


def _moved(function: Function, quantities: Sequence[Quantity], one: Quantity) -> FloatArray:
    """Return the changes of a result by one standard uncertainty of a quantity, along each independent direction."""
    directions = one.root.shape[1]
    moved = {other.name: np.zeros((2 * directions, other.root.shape[0])) for other in quantities}
    moved[one.name] = np.concatenate([one.root.T, -one.root.T])
    results = function(moved)
    return np.asarray(0.5 * (results[:directions] - results[directions:]))
