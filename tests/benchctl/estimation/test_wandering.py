"""A bias that wanders: demanded where there is one, of the right size, and nowhere else."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import benchctl.estimation.wandering as module
from benchctl.estimation.fit import Fit, Point, fit
from benchctl.estimation.noise import Noisy
from benchctl.estimation.noise_model import NoiseModel
from benchctl.estimation.wandering import PROCESSES, wandering
from tests.benchctl.diagnosis.toy_problem import INTERVAL_S, NOISE_V, TOTAL, Decay, Toy, toy, walked

BOTH = ("bias_random_walk", "flicker_noise")
SIZE = 0.1
"""Of the walk, in deviations of the white noise a root of a second."""


def fitted(problem: Toy, *effects: Decay) -> Fit:
    everything = np.ones(len(problem.step_names), np.bool_)
    point = Point(baseline=problem.baseline_start, effects=effects)
    return fit(problem, NoiseModel.of(problem).plain, point, everything)


def tried(problem: Toy, *effects: Decay, least_gain: float = 12.0) -> dict[str, Noisy]:
    plain = NoiseModel.of(problem).plain
    found = wandering(problem, plain, fitted(problem, *effects), least_gain=least_gain)
    return {one.effect: one for one in found}


def wanders(seed: int, *, size: float = SIZE, noises: tuple[str, ...] = BOTH) -> Toy:
    return toy(seed=seed, added_v=walked(size * NOISE_V, seed), noises=noises)


def flickers(seed: int, rms: float) -> Toy:
    """Flicker in the time domain, made in frequency: amplitudes of 1/√f with chance phases, through the pauses too."""
    times = toy().time_s
    count = 2 ** math.ceil(math.log2(times[-1] / INTERVAL_S))
    step_hz = 1.0 / (count * INTERVAL_S)
    hertz = step_hz * np.arange(1, count // 2 + 1)
    deviation = rms / np.sqrt(math.log(10.0) * hertz) * math.sqrt(step_hz)
    chance = np.random.default_rng([seed, 3])
    drawn = deviation / math.sqrt(2.0) * (chance.standard_normal((2, hertz.size)).T @ np.array([1.0, 1.0j]))
    wave = np.fft.irfft(np.concatenate([[0.0], drawn]), count) * count / math.sqrt(2.0)
    return toy(seed=seed, added_v=wave[np.rint(times / INTERVAL_S).astype(int)], noises=BOTH)


@pytest.mark.slow
def test_white_noise_demands_no_slow_process() -> None:
    gains = [one.gain for seed in range(8) for one in tried(toy(seed=seed, noises=BOTH), least_gain=-math.inf).values()]
    assert len(gains) == 16
    assert max(gains) < 10.0
    assert float(np.mean(gains)) < 1.0


def test_a_walk_is_found_with_its_size_inside_the_interval() -> None:
    logs, errors = [], []
    for seed in range(20):
        one = tried(wanders(seed, noises=BOTH[:1]), least_gain=0.0)["bias_random_walk"]
        assert one.gain > 20.0
        logs.append(math.log(one.size / SIZE))
        errors.append(one.log_error)
    inside = np.abs(logs) < 1.96 * np.array(errors)
    assert inside.sum() >= 16
    assert float(np.mean(errors)) < 0.5


def test_a_walk_is_sized_by_the_noise_of_rows_of_weight_one_though_the_encoder_makes_all_rows_noisier() -> None:
    problem = wanders(1, noises=BOTH[:1])
    plain = NoiseModel.of(problem).plain
    point, steps = Point(baseline=problem.baseline_start), np.ones(len(problem.step_names), np.bool_)
    volts = []
    for weight in (1.0, 0.8):
        whitener = replace(plain, weight=weight * plain.weight)
        one = fit(problem, whitener, point, steps)
        (walk,) = wandering(problem, whitener, one, least_gain=0.0)
        beside = fit(problem, walk.whitener, one, steps)
        volts.append(walk.size * beside.deviation / walk.whitener.innovation)
    assert volts[1] == pytest.approx(volts[0], rel=1e-3)


@pytest.mark.slow
def test_a_walk_is_told_from_flicker_and_flicker_from_a_walk() -> None:
    right = 0
    for seed in range(3):
        for problem, truth in ((wanders(seed, size=0.2), BOTH[0]), (flickers(seed, NOISE_V), BOTH[1])):
            gains = {name: one.gain for name, one in tried(problem).items()}
            right += max(gains, key=lambda name: gains[name]) == truth
    assert right == 6


def test_flicker_is_found_with_its_size() -> None:
    sizes = [tried(flickers(seed, NOISE_V))["flicker_noise"].size for seed in range(5)]
    assert float(np.median(sizes)) == pytest.approx(1.0, rel=0.25)


@pytest.mark.parametrize("rms", [0.6, 1.5, 3.0])
def test_means_that_hold_hardly_any_white_noise_do_not_mislead_the_size(
    rms: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = flickers(0, rms * NOISE_V)
    of_few = tried(problem)
    monkeypatch.setattr(module, "_BLOCK_S", 25 * INTERVAL_S)
    of_many = tried(problem)
    assert of_many.keys() == of_few.keys() == set(BOTH)
    for name, one in of_many.items():
        assert one.gain == pytest.approx(of_few[name].gain, abs=1.0)
        assert abs(math.log(one.size / of_few[name].size)) < 0.5 * of_few[name].log_error


def test_what_the_model_in_hand_can_follow_is_no_wandering() -> None:
    """A slow decay looks like a walk, unless the model has a decay that may be refitted."""
    truth = Decay(amplitude_v=2e-3, tau_s=200.0)
    problem = toy(truth, seed=1, noises=BOTH)
    assert tried(problem)
    assert tried(problem, Decay(amplitude_v=1.9e-3, tau_s=190.0)) == {}


@pytest.mark.parametrize("name", BOTH)
def test_only_what_is_a_hypothesis_is_tried(name: str) -> None:
    assert set(tried(wanders(0, noises=(name, "noise_rate_dependent")))) == {name}
    assert tried(wanders(0, noises=())) == {}


def test_what_gains_less_than_asked_is_not_returned() -> None:
    problem = wanders(1, size=0.02, noises=BOTH[:1])
    gain = tried(problem)["bias_random_walk"].gain
    assert "bias_random_walk" in tried(problem, least_gain=0.7 * gain)
    assert "bias_random_walk" not in tried(problem, least_gain=1.01 * gain)


def test_the_whitener_that_comes_with_it_makes_the_residual_white() -> None:
    problem = wanders(0, size=0.5)
    one = tried(problem)["bias_random_walk"]
    rest = fitted(problem).residual

    def correlation(column: np.ndarray) -> float:
        return float(column[1:] @ column[:-1]) / float(column @ column)

    assert correlation(rest) > 0.5
    assert abs(correlation(one.whitener(rest))) < 4.0 / math.sqrt(TOTAL)
    assert one.whitener.slow == PROCESSES["bias_random_walk"](one.size, INTERVAL_S, 1.0)


def test_held_out_steps_have_no_say() -> None:
    problem = wanders(0)
    plain = NoiseModel.of(problem).plain
    steps = np.arange(len(problem.step_names)) < 12
    point = Point(baseline=problem.baseline_start)
    first = wandering(problem, plain, fit(problem, plain, point, steps), least_gain=0.0)
    changed = toy(added_v=walked(SIZE * NOISE_V, 0) + np.where(steps[problem.step], 0.0, 0.5), noises=BOTH)
    second = wandering(changed, plain, fit(changed, plain, point, steps), least_gain=0.0)
    assert [one.size for one in second] == pytest.approx([one.size for one in first], rel=1e-6)


def test_of_very_many_rows_means_of_a_few_say_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = wanders(3)
    of_all = tried(problem)
    monkeypatch.setattr(module, "_MOST_ROWS", TOTAL // 2)
    of_means = tried(problem)
    assert of_means.keys() == of_all.keys() != set()
    for name, one in of_means.items():
        assert one.gain == pytest.approx(of_all[name].gain, rel=0.02)
        # flicker is fast in part
        assert abs(math.log(one.size / of_all[name].size)) < 2.0 * of_all[name].log_error


def test_processes_that_are_sure_to_gain_less_than_a_rival_are_not_told() -> None:
    problem = wanders(3)
    plain, one = NoiseModel.of(problem).plain, fitted(problem)
    gains = {noisy.effect: noisy.gain for noisy in wandering(problem, plain, one, least_gain=12.0)}
    most = max(gains.values())
    assert wandering(problem, plain, one, least_gain=12.0, rival=10.0 * most) == []
    beaten = wandering(problem, plain, one, least_gain=12.0, rival=0.9 * most)
    assert max(noisy.gain for noisy in beaten) == pytest.approx(most, rel=1e-6)
