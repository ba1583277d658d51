"""What an effect's freedom costs, against the integral that it stands for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from benchctl.estimation.evidence import occam_factor
from benchctl.estimation.fit import Fit, Point, fit
from benchctl.estimation.noise_model import NoiseModel
from benchctl_instruments.physics.effects.effect import Parameter
from tests.benchctl.diagnosis.toy_problem import Cubic, Decay, FloatArray, Ripple, Toy, ToyEffect, toy

EVERYTHING = np.ones(24, np.bool_)


def fitted(problem: Toy, *effects: ToyEffect) -> Fit:
    point = Point(baseline=problem.baseline_start, effects=effects)
    return fit(problem, NoiseModel.of(problem).plain, point, EVERYTHING)


def quieter(one: Fit, times: float) -> Fit:
    """The same fit, had the noise been so many times smaller."""
    products = replace(one.products, squares=one.products.squares / times**2)
    return replace(one, products=products)


@pytest.mark.parametrize(("truth", "free"), [(Cubic(size_v=5e-3), 1), (Decay(amplitude_v=5e-3, tau_s=150.0), 2)])
def test_the_cost_grows_with_the_logarithm_of_the_precision_of_each_parameter(truth: ToyEffect, free: int) -> None:
    one = fitted(toy(truth), truth)
    assert occam_factor(quieter(one, 10.0), 0) - occam_factor(one, 0) == pytest.approx(2.0 * free * math.log(10.0))


def test_a_shape_costs_what_the_mean_of_the_likelihood_over_its_width_is_below_the_best() -> None:
    truth = Decay(amplitude_v=8e-3, tau_s=150.0)
    problem = toy(truth, hypotheses=[Decay])
    best = fitted(problem, truth)
    (found,) = best.point.effects
    assert isinstance(found, Decay)

    def squares(tau_s: float) -> float:
        column = np.exp(-problem.time_s / tau_s)
        known = np.stack([problem.share, np.ones(column.size), column], axis=1)
        rest = problem.measured - known @ np.linalg.lstsq(known, problem.measured, rcond=None)[0]
        return float(rest @ rest)

    logs = np.linspace(math.log(found.tau_s) - 0.5, math.log(found.tau_s) + 0.5, 401)
    losses = np.array([squares(math.exp(log)) for log in logs.tolist()]) - best.squares
    mean = np.trapezoid(np.exp(-0.5 * losses / best.deviation**2), logs) / (1.0 + math.log(300.0 / 30.0))
    own = best.covariance[2:4, 2:4]
    size_error = math.sqrt(own[0, 0] - own[0, 1] ** 2 / own[1, 1])  # at a given time constant
    of_size = 2.0 * math.log(abs(found.amplitude_v) / (math.sqrt(2.0 * math.pi) * size_error))
    assert occam_factor(best, 0) - of_size == pytest.approx(-2.0 * math.log(mean), abs=0.1)


def test_an_effect_of_two_parameters_costs_more_than_one_of_one_that_fits_as_well() -> None:
    problem = toy(Decay(amplitude_v=5e-3, tau_s=150.0))
    decay = fitted(problem, Decay(amplitude_v=5e-3, tau_s=150.0))
    fixed = fitted(problem, _Fixed(amplitude_v=5e-3))
    assert occam_factor(decay, 0) > occam_factor(fixed, 0) + 5.0


def test_a_choice_costs_the_number_of_its_places_and_a_phase_a_whole_turn() -> None:
    truth = Ripple(amplitude_v=5e-3, phase_deg=40.0, order=2.0)
    one = fitted(toy(truth), truth)
    room = 2.0 * math.pi * math.sqrt(float(np.linalg.det(one.covariance[2:4, 2:4])))
    possible = one.point.effects[0].values["amplitude_v"] * 360.0 * 2.0
    assert occam_factor(one, 0) == pytest.approx(2.0 * math.log(possible / room))


def test_two_numbers_that_only_the_data_hold_together_cost_more_than_each_by_itself_says() -> None:
    truth = Decay(amplitude_v=5e-3, tau_s=5000.0)
    one = fitted(toy(truth), truth)
    errors = np.sqrt(np.diag(one.covariance))[2:4]
    alone = 2.0 * math.log(abs(one.point.effects[0].values["amplitude_v"]) / errors[0])
    assert errors[1] > 1.0
    assert occam_factor(one, 0) > alone


def test_what_the_data_leave_wholly_open_costs_nothing() -> None:
    problem = toy(noise_v=1.0)
    assert occam_factor(fitted(problem, Cubic(size_v=1e-6)), 0) == pytest.approx(0.0, abs=2.0)
    assert occam_factor(quieter(fitted(problem, Cubic(size_v=1e-6)), 1e-6), 0) == 0.0


def test_only_the_effect_at_the_place_pays() -> None:
    truth = Cubic(size_v=5e-3), Decay(amplitude_v=5e-3, tau_s=150.0)
    problem = toy(*truth)
    both, turned = fitted(problem, *truth), fitted(problem, *truth[::-1])
    assert occam_factor(both, 0) == pytest.approx(occam_factor(turned, 1), rel=1e-3)
    assert occam_factor(both, 1) == pytest.approx(occam_factor(turned, 0), rel=1e-3)
    assert occam_factor(both, 0) != pytest.approx(occam_factor(both, 1), rel=0.05)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fixed(ToyEffect):
    amplitude_v: float
    identifier: ClassVar[str] = "fixed"
    parameters: ClassVar[Mapping[str, Parameter]] = {"amplitude_v": Decay.parameters["amplitude_v"]}

    def column(self, problem: Toy) -> FloatArray:
        return Decay(amplitude_v=self.amplitude_v, tau_s=150.0).column(problem)
