"""What disturbs a chamber's air: as long as the air remembers, and as much wider as that makes what a fit says."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
import scipy.signal

from benchctl.diagnosis.chamber.problem import chamber_problem
from benchctl.estimation.disturbance import disturbance_of, disturbance_of_fit, pushed_in, with_disturbance
from benchctl.estimation.fit import Fit, Point, fit
from benchctl.estimation.noise_model import NoiseModel
from benchctl.estimation.problem import Problem
from tests.benchctl.diagnosis.made_chamber import GAIN_C_PER_PERCENT, ROOM_C, TAU_S, Truth, chamber_channels
from tests.benchctl.diagnosis.made_recording import recording_of

_LAG_S = 30.0


def _fitted(seed: int) -> tuple[Problem, Fit]:
    """A chamber with a second lag, and the fit of just that model."""
    problem = chamber_problem(recording_of(chamber_channels(Truth(second_lag_s=_LAG_S), seed)))
    lag = problem.effects["second_lag"].make({"tau_s": _LAG_S})
    every = np.ones(len(problem.step_names), np.bool_)
    point = Point(baseline=problem.baseline_start, effects=(lag,))
    return problem, fit(problem, NoiseModel.of(problem).whitener, point, every)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_draught_is_remembered_as_long_as_the_air_remembers_though_a_fit_takes_up_its_slowest_part(seed: int) -> None:
    problem, fitted = _fitted(seed)
    (process,) = disturbance_of_fit(problem, fitted).slow
    assert -problem.interval_s / math.log(process.remembers) == pytest.approx(TAU_S, rel=0.1)


@pytest.mark.parametrize("seed", [11, 12, 13])
@pytest.mark.parametrize("size", [0.2, 0.5, 1.5])
def test_what_is_forgotten_sooner_than_the_air_forgets_is_found_whatever_its_size(size: float, seed: int) -> None:
    problem, _ = _fitted(1)
    draws, rows = np.random.default_rng(seed), problem.measured.size
    pushes = math.sqrt(size) * draws.standard_normal(rows)
    felt = scipy.signal.lfilter([1.0], [1.0, -math.exp(-1.0 / 25.0)], pushes) + draws.standard_normal(rows)
    (process,) = disturbance_of(problem, 0.2 * felt, problem.baseline_start, ()).slow
    assert -1.0 / math.log(process.remembers) == pytest.approx(25.0, rel=0.5)
    assert process.drive == pytest.approx(size, rel=0.5)


def test_pushes_of_an_air_that_shares_its_heat_with_a_store_are_forgotten_as_its_own_equation_says() -> None:
    problem, _ = _fitted(1)
    store = problem.effects["heat_store"].make({"capacity": 2.0, "tau_s": 400.0})
    processes = pushed_in(problem, problem.baseline_start, (store,))
    interval_s, tau_s = problem.interval_s, float(problem.baseline_start[1])
    lags = np.arange(0, 2000, 100)
    told = sum(
        one.drive / (1.0 - one.remembers**2) * one.remembers**lags for one in processes
    )  # the covariance of the air, for pushes of unit power
    step_s, air, wall = 0.5, [1.0], 0.0
    for _ in range(round(40.0 * tau_s / step_s)):
        air.append(air[-1] - step_s * (air[-1] / tau_s + 2.0 / 400.0 * (air[-1] - wall)))
        wall += step_s * (air[-2] - wall) / 400.0
    response = np.array(air)
    shifts = np.round(lags * interval_s / step_s).astype(int)
    expected = [step_s * float(response[: response.size - k] @ response[k:]) for k in shifts.tolist()]
    assert np.asarray(told) == pytest.approx(expected, rel=0.02, abs=0.01 * expected[0])


def test_a_store_that_takes_up_nothing_changes_nothing_of_what_the_air_forgets() -> None:
    problem, _ = _fitted(1)
    tau_s = float(problem.baseline_start[1])
    (alone,) = pushed_in(problem, problem.baseline_start, ())
    store = problem.effects["heat_store"].make({"capacity": 0.0, "tau_s": tau_s})  # two rates that are one
    both = pushed_in(problem, problem.baseline_start, (store,))
    assert sum(one.drive for one in both) == pytest.approx(alone.drive)
    assert all(one.remembers == pytest.approx(alone.remembers) for one in both)


@pytest.mark.slow
def test_the_intervals_of_a_chamber_hold_its_truth() -> None:
    truth = {"gain_c_per_percent": GAIN_C_PER_PERCENT, "ambient_c": ROOM_C, (None, "tau_s"): TAU_S}
    inside: Counter[object] = Counter()
    for seed in range(1, 41):
        problem, fitted = _fitted(seed)
        covariance = with_disturbance(problem, fitted).robust_covariance(problem.step)
        for index, (number, error) in enumerate(zip(fitted.numbers, np.sqrt(np.diag(covariance)), strict=True)):
            key = (number.effect, number.name) if number.name == "tau_s" else number.name
            true = math.log(_LAG_S) if number.effect == 0 else truth.get(key)
            if true is not None:
                inside[key] += abs(fitted.point.value(number, index) - true) < 1.96 * error
    assert len(inside) == 4
    assert all(count >= 34 for count in inside.values()), inside  # by chance one set in a hundred and fifty has fewer
