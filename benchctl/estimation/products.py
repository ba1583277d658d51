"""What a fit needs of the rows, kept per step: products of whitened derivatives with each other and the residual.

What is compared beside the rows (`Problem.spectral_residual`) is added to its steps: it tells numbers, but is no row
from which the size of the noise is known.

A step is summed up some rows at a time, which stay in a core's own memory; several cores take some steps each.
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
"""For each thread: steps are not of one length."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Products:
    """Sums over each step's rows: information (m, p, p), gradient (m, p), squares (m,) and rows that count (m,)."""

    information: FloatArray
    gradient: FloatArray
    squares: FloatArray
    rows: FloatArray

    def of(self, steps: BoolArray) -> tuple[FloatArray, FloatArray, float, float]:
        """Their sums over some steps, given as a mask of shape (m,)."""
        return (
            self.information[steps].sum(axis=0),
            self.gradient[steps].sum(axis=0),
            float(self.squares[steps].sum()),
            float(self.rows[steps].sum()),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Spectral:
    """What is compared beside the rows: the residual (w,), and the derivatives (w, p) of what it is the residual of."""

    residual: FloatArray
    derivatives: FloatArray


def products_of(
    problem: Problem, derivatives: FloatArray, white: FloatArray, whitener: Whitener, spectral: Spectral
) -> Products:
    """The products per step of whitened derivatives (n, p) and residuals (n,)."""
    beside = spectral.derivatives
    information = _over_steps(problem, lambda rows: gram(derivatives[rows]))
    empty = Products(
        information=_added(problem, information, beside[:, :, None] * beside[:, None, :]),
        gradient=np.zeros((0, derivatives.shape[1])),
        squares=np.zeros(0),
        rows=_over_steps(problem, lambda rows: float(np.count_nonzero(whitener.weight[rows]))),
    )
    return with_residual(problem, empty, derivatives, white, spectral)


def with_residual(
    problem: Problem, products: Products, derivatives: FloatArray, white: FloatArray, spectral: Spectral
) -> Products:
    """The products with other residuals of the same derivatives."""

    def gradient(rows: slice) -> FloatArray:
        return sum((white[some] @ derivatives[some] for some in in_cache(rows)), np.zeros(derivatives.shape[1]))

    return replace(
        products,
        gradient=_added(problem, _over_steps(problem, gradient), spectral.derivatives * spectral.residual[:, None]),
        squares=squares_of(problem, white, spectral.residual),
    )


def squares_of(problem: Problem, white: FloatArray, beside: FloatArray) -> FloatArray:
    """The sums of squares of each step's whitened rows (n,) and of what is compared beside them (w,), shape (m,)."""
    rows = _over_steps(problem, lambda rows: sum(float(white[some] @ white[some]) for some in in_cache(rows)))
    return _added(problem, rows, beside**2)


def _added(problem: Problem, sums: FloatArray, values: FloatArray) -> FloatArray:
    """Sums of steps (m, …) with values (w, …) of what is compared beside the rows."""
    np.add.at(sums, problem.spectral_step, values)
    return sums


def _over_steps(problem: Problem, summed: Callable[[slice], FloatArray | float]) -> FloatArray:
    """What is summed over the rows of every step, shape (m, …); each thread takes some steps in a row."""
    bounds = np.searchsorted(problem.step, np.arange(len(problem.step_names) + 1)).tolist()
    steps = [slice(first, last) for first, last in itertools.pairwise(bounds)]
    parts = parts_of(len(steps), _PARTS * threads())
    sums = shared_out(lambda part: [summed(rows) for rows in steps[part]], parts)
    return np.array([one for part in sums for one in part])
