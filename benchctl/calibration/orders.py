"""Orders of the polynomials, chosen on whole runs that the fit has not seen (cross-validation)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from benchctl.calibration.joint import JointProblem, fit_joint, predict
from benchctl.calibration.model import Law
from benchctl.calibration.reduce import ReducedStep
from benchctl.calibration.rows import gather
from benchctl_instruments.errors import UsageError

FloatArray = npt.NDArray[np.float64]

MOST_RATE_TERMS = 3
FOLDS = 4


def choose_orders(
    base: JointProblem, steps: Sequence[ReducedStep], start: FloatArray, most_temperature_terms: int
) -> tuple[int, int, str]:
    """Terms of k(T) and k(ω) of the polynomial law, and a sentence on why.

    Each candidate is fitted to three quarters of the moving runs and predicts the rest, four times; the smallest one
    whose squared error is within one standard error of the best is taken (Breiman's rule).
    """
    moving = [i for i, step in enumerate(steps) if step.kind != "static"]
    if len(moving) < 2 * FOLDS:
        return most_temperature_terms, 2, "Orders were not chosen: too few runs to keep a quarter aside."
    scores: dict[tuple[int, int], FloatArray] = {}
    for temperature_terms in range(most_temperature_terms + 1):
        for rate_terms in range(1, MOST_RATE_TERMS + 1):
            law = Law(name="polynomial", rate_terms=rate_terms, temperature_terms=temperature_terms)
            scores[temperature_terms, rate_terms] = _held_out(replace(base, law=law), steps, start, moving)
    totals = {orders: float(np.mean(score)) for orders, score in scores.items()}
    best = min(totals, key=lambda orders: totals[orders])
    if not np.isfinite(totals[best]):
        raise UsageError(
            "calibration: no order of the polynomials can be fitted to three quarters of the runs; "
            "record more rates and temperatures, or take the paper's orders"
        )
    margin = {
        orders: float(np.std(score - scores[best], ddof=1) / np.sqrt(score.size)) for orders, score in scores.items()
    }
    enough = [orders for orders in totals if totals[orders] <= totals[best] + margin[orders]]
    chosen = min(enough, key=lambda orders: (sum(orders), totals[orders]))
    return (
        *chosen,
        f"Orders chosen on runs left out: {chosen[0]} term(s) in temperature, {chosen[1]} in rate "
        f"(rms {1e3 * totals[chosen] ** 0.5:.3g} mV; the best, {best[0]} and {best[1]}: "
        f"{1e3 * totals[best] ** 0.5:.3g} mV).",
    )


def _held_out(
    problem: JointProblem, steps: Sequence[ReducedStep], base_start: FloatArray, moving: list[int]
) -> FloatArray:
    """Mean squared error of each moving run, V², when it was not among the fitted ones; shape (len(moving),)."""
    start = np.zeros(len(problem.names))
    start[0] = base_start[0]
    start[len(problem.law.names) :] = base_start[-(len(problem.names) - len(problem.law.names)) :]
    errors = np.full(len(moving), np.inf)
    for fold in range(FOLDS):
        aside = moving[fold::FOLDS]
        kept = [step for i, step in enumerate(steps) if i not in aside]
        try:
            solution = fit_joint(problem, kept, start)
        except UsageError:
            return errors  # this order folds over inside the range: not a candidate
        rows = gather([steps[i] for i in aside], problem.T0_c)
        output, _ = predict(problem, solution.estimate, rows)
        residual = rows.output_v - output
        errors[fold::FOLDS] = rows.means(residual**2)
    return errors
