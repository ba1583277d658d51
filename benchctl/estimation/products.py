"""Sums per step that a fit needs: products of whitened derivatives with each other and with the residual.

Residuals that are compared in addition to the rows (`Problem.spectral_residual`) are added to their steps: they
determine numbers, but do not count for the size of the noise.

A step is summed over groups of rows that fit into a core's cache; several cores process some steps each.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchctl.estimation.noise import Whitener
from benchctl.estimation.problem import Problem
from benchctl.side_by_side import parts_of, shared_out, threads
from benchctl.signals.blocks import gram, in_cache
from benchctl_instruments.arrays import BoolArray, FloatArray

_PARTS = 8
"""Number of parts per thread; steps differ in length."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Products:
    """Sums over each step's rows: information (m, p, p), gradient (m, p), squares (m,) and rows that count (m,)."""

    information: FloatArray
    gradient: FloatArray
    squares: FloatArray
    rows: FloatArray

    def of(self, steps: BoolArray) -> tuple[FloatArray, FloatArray, float, float]:
        """Return the sums over some steps, given as a mask of shape (m,)."""
        return (
            self.information[steps].sum(axis=0),
            self.gradient[steps].sum(axis=0),
            float(self.squares[steps].sum()),
            float(self.rows[steps].sum()),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Spectral:
    """Data compared in addition to the rows: the residual (w,), and the derivatives (w, p) of its prediction."""

    residual: FloatArray
    derivatives: FloatArray


def products_of(
    problem: Problem,
    derivatives: FloatArray,
    white: FloatArray,
    whitener: Whitener,
    spectral: Spectral,
    known: Products | None = None,
) -> Products:
    """Return the products per step of whitened derivatives (n, p) and residuals (n,).

    `known` are those of the first derivatives with each other, if they were computed before with the same whitener.
    """
    extra, many = spectral.derivatives, derivatives.shape[1]
    first = 0 if known is None else known.gradient.shape[1]
    new = _over_steps(problem, lambda rows: gram(derivatives[rows], first))
    new = _added(problem, new, extra[:, :, None] * extra[:, None, first:])
    if known is None:
        information, rows = new, _over_steps(problem, lambda rows: float(np.count_nonzero(whitener.weight[rows])))
    else:
        information, rows = np.empty((len(new), many, many)), known.rows
        information[:, :first, :first] = known.information
        information[:, :, first:] = new
        information[:, first:, :first] = new[:, :first].transpose(0, 2, 1)
    empty = Products(information=information, gradient=np.zeros((0, many)), squares=np.zeros(0), rows=rows)
    return with_residual(problem, empty, derivatives, white, spectral)


def with_residual(
    problem: Problem, products: Products, derivatives: FloatArray, white: FloatArray, spectral: Spectral
) -> Products:
    """Return the products with other residuals of the same derivatives."""

    def gradient(rows: slice) -> FloatArray:
        return sum((white[some] @ derivatives[some] for some in in_cache(rows)), np.zeros(derivatives.shape[1]))

    return replace(
        products,
        gradient=_added(problem, _over_steps(problem, gradient), spectral.derivatives * spectral.residual[:, None]),
        squares=squares_of(problem, white, spectral.residual),
    )


def squares_of(problem: Problem, white: FloatArray, others: FloatArray) -> FloatArray:
    """Return the sum of squares of each step's whitened rows (n,) and `others` residuals (w,); (m,)."""
    rows = _over_steps(problem, lambda rows: sum(float(white[some] @ white[some]) for some in in_cache(rows)))
    return _added(problem, rows, others**2)


def _added(problem: Problem, sums: FloatArray, values: FloatArray) -> FloatArray:
    """Add values (w, …) of the additional residuals to the sums of their steps (m, …)."""
    np.add.at(sums, problem.spectral_step, values)
    return sums


def _over_steps(problem: Problem, summed: Callable[[slice], FloatArray | float]) -> FloatArray:
    """Return the sums over the rows of every step, shape (m, …); each thread processes consecutive steps."""
    bounds = np.searchsorted(problem.step, np.arange(len(problem.step_names) + 1)).tolist()
    steps = [slice(first, last) for first, last in itertools.pairwise(bounds)]
    parts = parts_of(len(steps), _PARTS * threads())
    sums = shared_out(lambda part: [summed(rows) for rows in steps[part]], parts)
    return np.array([one for part in sums for one in part])
