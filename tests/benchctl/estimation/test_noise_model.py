"""What is known of a recording's noise, and what becomes of it as findings come and go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.estimation.fit import Fit, Point, fit
from benchctl.estimation.noise import Noisy, walk
from benchctl.estimation.noise_model import GROWING, NoiseModel
from tests.benchctl.diagnosis.toy_problem import INTERVAL_S, NOISE_V, TOTAL, Decay, Toy, toy, walked

ALL = ("bias_random_walk", "flicker_noise", GROWING)
EVERYTHING = np.ones(24, np.bool_)


def fitted(problem: Toy, model: NoiseModel | None = None) -> Fit:
    known = model or NoiseModel.of(problem)
    return fit(problem, known.whitener, Point(baseline=problem.baseline_start), EVERYTHING)


def levelled(problem: Toy) -> NoiseModel:
    return NoiseModel.of(problem).levelled(problem, fitted(problem))


def growing_toy(factor: float, *, walk_v: float = 0.0, seed: int = 0) -> Toy:
    chance = np.random.default_rng([seed, 5])
    more = NOISE_V * np.sqrt(factor**2 - 1.0) * np.abs(toy().share) * chance.standard_normal(TOTAL)
    return toy(seed=seed, added_v=more + walked(walk_v, seed), noises=ALL)


def noisy(name: str, model: NoiseModel, *, gain: float = 50.0, slow: float = 0.0, weight: float = 1.0) -> Noisy:
    whitener = replace(model.plain, slow=walk(slow, INTERVAL_S) if slow else (), weight=weight * model.plain.weight)
    return Noisy(effect=name, gain=gain, size=1.0, log_error=0.1, whitener=whitener)


def test_rows_that_are_spoilt_weigh_nothing_and_all_others_the_same() -> None:
    usable = np.arange(TOTAL) % 7 > 0
    model = NoiseModel.of(replace(toy(), usable=usable))
    assert np.array_equal(model.plain.weight, usable.astype(np.float64))
    assert model.whitener is model.plain
    assert model.found == {}


def test_the_level_is_that_of_the_white_noise_whatever_the_model_has_left_out() -> None:
    missing = Decay(amplitude_v=50 * NOISE_V, tau_s=100.0)
    spikes = np.where(np.arange(TOTAL) % 50 == 0, 300.0 * NOISE_V, 0.0)
    problem = toy(missing, added_v=spikes)
    assert levelled(problem).level == pytest.approx(NOISE_V, rel=0.1)
    assert fitted(problem).deviation > 10.0 * NOISE_V


def test_spoilt_rows_have_no_say_in_the_level() -> None:
    usable = np.arange(TOTAL) % 3 > 0
    spoilt = toy(added_v=np.where(usable, 0.0, 1.0))
    assert levelled(replace(spoilt, usable=usable)).level == pytest.approx(NOISE_V, rel=0.08)


def test_data_without_any_noise_have_a_level_all_the_same() -> None:
    silent = toy(noise_v=0.0, added_v=np.where(np.arange(TOTAL) % 400 == 0, 1e-3, 0.0))
    assert levelled(silent).level > 0.0


def test_what_the_encoder_brings_lowers_the_weight_of_a_row_by_as_much() -> None:
    whole = np.where(toy().share > 0.5, 3.0 * NOISE_V**2, 0.0)
    problem = replace(toy(), regressor_variance=(whole, np.zeros(TOTAL)))
    model = levelled(problem)
    assert model.plain.weight == pytest.approx(1.0 / np.sqrt(1.0 + whole / model.level**2))
    assert float(model.plain.weight.min()) == pytest.approx(0.5, rel=0.03)


def test_a_wandering_bias_of_another_kind_gives_way_and_all_else_stays() -> None:
    model = levelled(toy())
    model = model.with_(noisy(GROWING, model)).with_(noisy("bias_random_walk", model))
    model = model.with_(last := noisy("flicker_noise", model))
    assert set(model.found) == {GROWING, "flicker_noise"}
    assert model.whitener is last.whitener


def test_dropping_keeps_what_the_other_finding_put_into_the_whitener() -> None:
    model = levelled(toy())
    model = model.with_(noisy(GROWING, model, weight=0.5)).with_(noisy("bias_random_walk", model, weight=0.5, slow=0.3))
    grown, wandering = model.dropped(["bias_random_walk"]), model.dropped([GROWING])
    assert set(grown.found) == {GROWING}
    assert grown.whitener.slow == ()
    assert np.array_equal(grown.whitener.weight, 0.5 * model.plain.weight)
    assert set(wandering.found) == {"bias_random_walk"}
    assert wandering.whitener.slow == walk(0.3, INTERVAL_S)
    assert np.array_equal(wandering.whitener.weight, model.plain.weight)
    assert model.dropped(ALL).whitener.slow == ()
    assert model.dropped(["cubic"]) is model


def test_of_what_wanders_and_what_grows_that_which_gains_more_comes_first_and_the_other_next() -> None:
    problem = growing_toy(6.0, walk_v=1e-4)
    model = levelled(problem)
    first = model.best(problem, fitted(problem), least_gain=12.0)
    assert first is not None
    assert first.effect == GROWING
    model = model.with_(first)
    second = model.best(problem, fitted(problem, model), least_gain=12.0)
    assert second is not None
    assert second.effect in ("bias_random_walk", "flicker_noise")
    assert second.gain < first.gain
    # the whitener of what wanders holds the weights of what grows
    assert second.whitener.weight == pytest.approx(first.whitener.weight)
    whole = model.with_(second)
    assert whole.best(problem, fitted(problem, whole), least_gain=12.0) is None


def test_noise_that_grows_is_weighed_by_what_it_has_become() -> None:
    problem = growing_toy(4.0)
    found = levelled(problem).best(problem, fitted(problem), least_gain=12.0)
    assert found is not None
    assert np.sqrt(1.0 + found.size) == pytest.approx(4.0, rel=0.12)
    assert found.whitener.weight == pytest.approx(1.0 / np.sqrt(1.0 + found.size * problem.share**2))
    white = fit(problem, found.whitener, Point(baseline=problem.baseline_start), EVERYTHING).white
    fast = np.abs(problem.share) > 0.8
    assert float(white[fast].std() / white[problem.share == 0.0].std()) == pytest.approx(1.0, abs=0.1)


def test_on_white_noise_nothing_is_found() -> None:
    for seed in range(6):
        problem = toy(seed=seed, noises=ALL)
        assert levelled(problem).best(problem, fitted(problem), least_gain=12.0) is None


def test_what_gains_too_little_beside_another_fit_is_gone() -> None:
    """A decay was taken for a slow process; beside the decay none is left."""
    missing = Decay(amplitude_v=3e-3, tau_s=200.0)
    problem = toy(missing, noises=ALL)
    model = levelled(problem)
    best = model.best(problem, fitted(problem), least_gain=12.0)
    assert best is not None
    model = model.with_(best)
    beside = fit(problem, model.whitener, Point(baseline=problem.baseline_start, effects=(missing,)), EVERYTHING)
    again = model.measured(problem, beside, least_gain=12.0)
    assert again.found == {}
    assert again.whitener.slow == ()


def test_what_still_gains_is_measured_anew() -> None:
    problem = growing_toy(3.0)
    model = levelled(problem)
    model = model.with_(noisy(GROWING, model))
    again = model.measured(problem, fitted(problem, model), least_gain=12.0)
    assert np.sqrt(1.0 + again.found[GROWING].size) == pytest.approx(3.0, rel=0.12)
    assert again.whitener is again.found[GROWING].whitener
