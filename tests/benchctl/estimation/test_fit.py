"""The joint fit: against ordinary least squares, repeated draws, and steps really left out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.estimation.fit import Fit, Point, _inside, fit, gain_kept, gain_of, inverse, solve
from benchctl.estimation.noise import Whitener, walk
from benchctl.estimation.noise_model import NoiseModel
from tests.benchctl.diagnosis.toy_problem import (
    INTERVAL_S,
    K0,
    NOISE_V,
    RANGE_DPS,
    ROWS,
    STEPS,
    TOTAL,
    U0,
    Cubic,
    Decay,
    FloatArray,
    Ripple,
    Squared,
    Toy,
    ToyEffect,
    toy,
)

EVERYTHING = np.ones(STEPS, np.bool_)
FOLDS = np.arange(STEPS) % 6


def plain(problem: Toy) -> Whitener:
    return NoiseModel.of(problem).plain


def fitted(problem: Toy, *effects: ToyEffect, steps: FloatArray | None = None) -> Fit:
    chosen = EVERYTHING if steps is None else np.asarray(steps, np.bool_)
    return fit(problem, plain(problem), Point(baseline=problem.baseline_start, effects=effects), chosen)


def columns(problem: Toy, *effects: ToyEffect) -> FloatArray:
    """What a linear model is made of, shape (n, p)."""
    known = [problem.share * RANGE_DPS, np.ones(TOTAL)]
    known += [one.column(problem) / next(iter(one.values.values())) for one in effects]
    return np.stack(known, axis=1)


def test_a_linear_model_is_fitted_as_by_least_squares() -> None:
    problem = toy(Cubic(size_v=3e-3))
    one = fitted(problem, Cubic(size_v=1e-4))
    known = columns(problem, Cubic(size_v=1.0))
    values, squares, *_ = np.linalg.lstsq(known, problem.measured, rcond=None)
    (cubic,) = one.point.effects
    assert [*one.point.baseline, cubic.values["size_v"]] == pytest.approx(values.tolist(), rel=1e-7)
    assert one.squares == pytest.approx(float(squares[0]))
    assert one.deviation**2 == pytest.approx(one.squares / (TOTAL - 3))
    expected = np.linalg.inv(known.T @ known) * one.deviation**2
    assert one.covariance == pytest.approx(expected, rel=1e-6)
    assert one.predicted + one.residual == pytest.approx(problem.measured)


def test_steps_that_are_not_fitted_have_no_say() -> None:
    steps = FOLDS != 3
    problem = toy(Cubic(size_v=3e-3))
    spoilt = replace(problem, measured=problem.measured + np.where(steps[problem.step], 0.0, 7.0))
    first, second = (fitted(one, Cubic(size_v=1e-4), steps=steps) for one in (problem, spoilt))
    assert np.array_equal(first.point.baseline, second.point.baseline)
    assert first.point.effects == second.point.effects
    assert first.rows == steps.sum() * ROWS


def test_rows_that_do_not_count_have_no_say() -> None:
    usable = np.arange(TOTAL) % 11 > 0
    problem = replace(toy(), usable=usable)
    spoilt = replace(problem, measured=np.where(usable, problem.measured, 99.0))
    assert np.array_equal(fitted(problem).point.baseline, fitted(spoilt).point.baseline)
    assert fitted(problem).rows == usable.sum()


def test_shapes_and_phases_are_found_from_a_start_nearby() -> None:
    truth = Decay(amplitude_v=8e-3, tau_s=150.0), Ripple(amplitude_v=2e-3, phase_deg=350.0, order=2.0)
    begun = Decay(amplitude_v=1e-3, tau_s=300.0), Ripple(amplitude_v=1e-3, phase_deg=10.0, order=2.0)
    one = fitted(toy(*truth), *begun)
    decay, ripple = (effect.values for effect in one.point.effects)
    errors = dict(zip([(n.effect, n.name) for n in one.numbers], np.sqrt(np.diag(one.covariance)), strict=True))
    assert abs(math.log(decay["tau_s"] / 150.0)) < 4.0 * errors[0, "tau_s"]
    assert abs(ripple["phase_deg"] - 350.0) < 4.0 * errors[1, "phase_deg"]
    assert abs(ripple["amplitude_v"] - 2e-3) < 4.0 * errors[1, "amplitude_v"]
    assert ripple["order"] == 2.0


def test_the_errors_are_those_of_repeated_draws() -> None:
    truth = Decay(amplitude_v=8e-3, tau_s=150.0)
    fits = [fitted(toy(truth, seed=seed), truth) for seed in range(120)]
    drawn = np.array([[one.point.value(n, i) for i, n in enumerate(one.numbers)] for one in fits])
    stated = np.sqrt(np.mean([np.diag(one.covariance) for one in fits], axis=0))
    assert drawn.std(axis=0) / stated == pytest.approx(np.ones(4), abs=0.22)


def test_a_number_at_its_bound_holds_still_and_the_others_go_their_own_way() -> None:
    """The data want a time constant beyond the longest: amplitude and baseline are then those for the longest."""
    problem = toy(added_v=1e-6 * toy().time_s)
    one = fitted(problem, Decay(amplitude_v=-1e-3, tau_s=9e3))
    (decay,) = one.point.effects
    assert decay.values["tau_s"] == 1e4
    known = columns(problem, Decay(amplitude_v=1.0, tau_s=1e4))
    values = np.linalg.lstsq(known, problem.measured, rcond=None)[0]
    assert decay.values["amplitude_v"] == pytest.approx(values[2], rel=1e-4)
    assert one.point.baseline == pytest.approx(values[:2], rel=1e-4)
    assert np.isfinite(one.derivatives).all()


def test_two_effects_that_are_one_leave_a_fit_and_a_finite_covariance() -> None:
    problem = toy(Squared(size_v=5e-3))
    one = fitted(problem, Squared(size_v=1e-3), Squared(size_v=2e-3))
    assert sum(effect.values["size_v"] for effect in one.point.effects) == pytest.approx(5e-3, rel=0.1)
    assert np.isfinite(one.covariance).all()


@given(scales=st.lists(st.floats(-8.0, 8.0), min_size=3, max_size=3), seed=st.integers(0, 50))
@settings(max_examples=40, deadline=None)
def test_the_inverse_does_not_mind_the_units(scales: list[float], seed: int) -> None:
    draws = np.random.default_rng(seed).standard_normal((40, 3))
    information, units = draws.T @ draws, 10.0 ** np.array(scales)
    scaled = information * np.outer(units, units)
    assert inverse(scaled) * np.outer(units, units) == pytest.approx(np.linalg.inv(information), rel=1e-8)
    assert solve(scaled, units * information[0]) * units == pytest.approx([1.0, 0.0, 0.0], abs=1e-8)


def test_what_is_not_seen_has_no_variance_and_is_not_moved() -> None:
    information = np.diag([4.0, 0.0, 1.0])
    assert inverse(information) == pytest.approx(np.diag([0.25, 0.0, 1.0]))
    assert solve(information, np.array([8.0, 5.0, 3.0])) == pytest.approx([2.0, 0.0, 3.0])


def coloured(seed: int, remembers: float) -> FloatArray:
    driven = np.random.default_rng([seed, 9]).standard_normal(TOTAL)
    return NOISE_V * np.asarray(scipy.signal.lfilter([1.0], [1.0, -remembers], driven))


def test_the_robust_covariance_is_the_plain_one_where_noise_is_white() -> None:
    problem = toy(Decay(amplitude_v=8e-3, tau_s=150.0))
    one = fitted(problem, Decay(amplitude_v=8e-3, tau_s=150.0))
    ratio = np.diag(one.robust_covariance(problem.step)) / np.diag(one.covariance)
    assert (ratio >= 1.0 - 1e-12).all()
    assert ratio.max() < 1.8


def test_under_coloured_noise_the_robust_errors_are_those_of_repeated_draws() -> None:
    values, robust, usual = [], [], []
    for seed in range(80):
        problem = toy(noise_v=0.0, added_v=coloured(seed, 0.8))
        one = fitted(problem)
        values.append(one.point.baseline)
        robust.append(np.diag(one.robust_covariance(problem.step)))
        usual.append(np.diag(one.covariance))
    drawn = np.var(values, axis=0)
    assert np.sqrt(np.mean(robust, axis=0) / drawn) == pytest.approx(np.ones(2), abs=0.3)
    assert (drawn > 4.0 * np.mean(usual, axis=0)).all()


def test_a_gain_is_the_fall_of_twice_the_log_likelihood() -> None:
    problem = toy(Squared(size_v=1e-3))
    worse, better = fitted(problem), fitted(problem, Squared(size_v=1e-3))
    assert gain_of(better, worse) == pytest.approx(TOTAL * math.log(worse.squares / better.squares))
    first = FOLDS == 0
    here = TOTAL / 6 * math.log(worse.products.squares[first].sum() / better.products.squares[first].sum())
    assert gain_of(better, worse, first) == pytest.approx(here)


def really_left_out(problem: Toy, *effects: ToyEffect) -> float:
    """Squares on each fold of a least-squares fit to the others."""
    known, total = columns(problem, *effects), 0.0
    for fold in range(6):
        out = np.equal(FOLDS, fold)[problem.step]
        values = np.linalg.lstsq(known[~out], problem.measured[~out], rcond=None)[0]
        total += float(np.sum((problem.measured[out] - known[out] @ values) ** 2))
    return total


@pytest.mark.parametrize("size_v", [0.0, 2e-4, 2e-3])
def test_what_is_kept_is_what_steps_really_left_out_would_say(size_v: float) -> None:
    problem, effect = toy(Squared(size_v=size_v), seed=3), Squared(size_v=1e-3)
    kept = gain_kept(fitted(problem, effect), fitted(problem), FOLDS)
    exact = TOTAL * math.log(really_left_out(problem) / really_left_out(problem, effect))
    assert kept == pytest.approx(exact, abs=1e-3 + 1e-4 * abs(exact))


def test_an_effect_that_is_there_is_kept_and_a_column_of_chance_is_not() -> None:
    true = [toy(Squared(size_v=3e-4), seed=seed) for seed in range(20)]
    assert min(gain_kept(fitted(one, Squared(size_v=1e-4)), fitted(one), FOLDS) for one in true) > 0.0
    chance = [toy(seed=seed) for seed in range(150)]
    kept = np.array([gain_kept(fitted(one, Squared(size_v=1e-4)), fitted(one), FOLDS) for one in chance])
    brought = np.array([gain_of(fitted(one, Squared(size_v=1e-4)), fitted(one)) for one in chance[:40]])
    assert (brought >= 0.0).all()
    assert float(kept.mean()) + 2.0 * float(kept.std()) / math.sqrt(150) < 0.0


def test_under_a_walk_the_whitened_fit_is_generalised_least_squares() -> None:
    problem = toy(Squared(size_v=3e-3))
    joined = Whitener(
        interval_s=INTERVAL_S,
        weight=np.ones(TOTAL),
        slow=walk(0.5, INTERVAL_S),
        time_s=INTERVAL_S * np.arange(TOTAL, dtype=np.float64),
    )
    point = Point(baseline=problem.baseline_start, effects=(Squared(size_v=1e-3),))
    one = fit(problem, joined, point, EVERYTHING)
    drive = 0.25 * INTERVAL_S
    start = 0.5 * (drive + math.sqrt(drive**2 + 4.0 * drive))
    index = np.arange(TOTAL, dtype=np.float64)
    root = np.linalg.cholesky(start + drive * np.minimum.outer(index, index) + np.eye(TOTAL))
    known = np.linalg.solve(root, columns(problem, Squared(size_v=1.0)))
    values = np.linalg.lstsq(known, np.linalg.solve(root, problem.measured), rcond=None)[0]
    (squared,) = one.point.effects
    assert [*one.point.baseline, squared.values["size_v"]] == pytest.approx(values.tolist(), rel=1e-6, abs=1e-8)
    # the whitener's innovations are larger than the white noise: errors know that
    rest = np.linalg.solve(root, problem.measured) - known @ values
    expected = np.linalg.inv(known.T @ known) * float(rest @ rest) / (TOTAL - 3)
    assert one.covariance == pytest.approx(expected, rel=1e-4)


def test_the_fit_begins_where_it_is_told_and_ends_there_without_rounds() -> None:
    problem = toy()
    start = Point(baseline=np.array([1.1 * K0, U0]))
    one = fit(problem, plain(problem), start, EVERYTHING, rounds=0)
    assert np.array_equal(one.point.baseline, start.baseline)
    assert one.residual == pytest.approx(problem.measured - problem.predict(start.baseline, ()))


def test_a_step_too_small_to_move_any_number_is_none() -> None:
    point = Point(baseline=np.array([1.0]))
    numbers = tuple(point.free(["K0"]))
    step = _inside(point, numbers, np.array([1.0]), np.eye(1), np.array([1e-20]))
    assert np.abs(step).max() < 1e-16


def walking(problem: Toy) -> Whitener:
    return replace(plain(problem), slow=walk(0.5, INTERVAL_S))


@pytest.mark.parametrize("whitener_of", [plain, walking])
def test_a_fit_that_goes_on_from_another_ends_where_one_from_its_model_does(
    whitener_of: Callable[[Toy], Whitener],
) -> None:
    usable = np.arange(TOTAL) % 11 > 0
    problem = replace(toy(Decay(amplitude_v=8e-3, tau_s=150.0), Squared(size_v=3e-3)), usable=usable)
    begun = fitted(problem, Decay(amplitude_v=8e-3, tau_s=150.0))
    on, anew = (fit(problem, whitener_of(problem), start, EVERYTHING) for start in (begun, begun.point))
    assert on.squares == pytest.approx(anew.squares, rel=1e-8)
    ours, theirs = ([one.point.value(n, i) for i, n in enumerate(one.numbers)] for one in (on, anew))
    assert np.abs(np.subtract(ours, theirs) / np.sqrt(np.diag(anew.covariance))).max() < 0.01
    assert on.covariance == pytest.approx(anew.covariance, rel=1e-3)


@pytest.mark.parametrize("whitener_of", [plain, walking])
def test_a_fit_keeps_its_derivatives_as_they_were_before_they_were_whitened(
    whitener_of: Callable[[Toy], Whitener],
) -> None:
    usable = np.arange(TOTAL) % 11 > 0
    problem = replace(toy(), usable=usable)
    one = fit(problem, whitener_of(problem), Point(baseline=problem.baseline_start), EVERYTHING)
    raw = one.raw_derivatives
    assert raw[usable] == pytest.approx(columns(problem)[usable], rel=1e-6, abs=1e-9)
    again = np.stack([one.whitener(column) for column in raw.T], axis=1)
    assert again[usable] == pytest.approx(one.derivatives[usable], abs=1e-9 * float(np.abs(raw).max()))
    raw[:] = 0.0
    assert one.raw_derivatives[usable].any()


def test_a_light_fit_says_the_same_without_its_derivatives() -> None:
    problem = toy(Squared(size_v=1e-3))
    worse, better = fitted(problem), fitted(problem, Squared(size_v=1e-3))
    assert worse.light.derivatives.size == 0
    assert gain_of(better, worse.light) == gain_of(better, worse)
    assert np.array_equal(worse.light.covariance, worse.covariance)
