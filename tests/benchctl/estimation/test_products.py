"""Products per step: those of each step's rows, however many there are."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.estimation.fit import Fit, Point, fit
from benchctl.estimation.noise_model import NoiseModel
from benchctl.estimation.products import products_of, squares_of, with_residual
from benchctl.signals import blocks
from tests.benchctl.diagnosis.toy_problem import STEPS, TOTAL, Squared, Toy, toy

EVERYTHING = np.ones(STEPS, np.bool_)


def fitted(problem: Toy) -> Fit:
    point = Point(baseline=problem.baseline_start, effects=(Squared(size_v=1e-3),))
    return fit(problem, NoiseModel.of(problem).plain, point, EVERYTHING)


def test_the_products_per_step_add_up_to_those_of_all_rows() -> None:
    one = fitted(toy())
    information, gradient, squares, rows = one.products.of(EVERYTHING)
    assert information == pytest.approx(one.derivatives.T @ one.derivatives)
    assert gradient == pytest.approx(one.derivatives.T @ one.white, abs=1e-7)
    assert squares == pytest.approx(float(one.white @ one.white))
    assert rows == TOTAL


@pytest.mark.parametrize("together", [1, 7, 10_000])
def test_how_many_rows_are_summed_up_at_a_time_does_not_matter(together: int, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = toy()
    one = fitted(problem)
    monkeypatch.setattr(blocks, "_TOGETHER", together)
    again = products_of(problem, one.derivatives, one.white, one.whitener, one.spectral)
    here = problem.step == 3
    assert again.information[3] == pytest.approx(one.derivatives[here].T @ one.derivatives[here])
    assert again.gradient[3] == pytest.approx(one.white[here] @ one.derivatives[here], abs=1e-9)
    assert again.squares[3] == pytest.approx(float(np.sum(one.white[here] ** 2)))


def test_another_residual_changes_the_gradient_and_the_squares_alone() -> None:
    problem = toy()
    one = fitted(problem)
    again = with_residual(problem, one.products, one.derivatives, 2.0 * one.white, one.spectral)
    assert again.information is one.products.information
    assert again.gradient == pytest.approx(2.0 * one.products.gradient, abs=1e-9)
    assert again.squares == pytest.approx(4.0 * squares_of(problem, one.white, one.spectral.residual))
