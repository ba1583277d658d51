"""Scores of every hypothesis at once, and the gain that chance reaches: against real fits and white noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
import scipy.signal
from scipy.stats import chi2

import benchctl.diagnosis.search.screen as screening
from benchctl.diagnosis.search.probes import Probe, probes_of
from benchctl.diagnosis.search.screen import Screening, screen
from benchctl.estimation.fit import Fit, Point, fit, gain_of
from benchctl.estimation.noise_model import NoiseModel
from benchctl_instruments.physics.effects.effect import DescribedEffect, Parameter
from tests.benchctl.diagnosis.toy_problem import (
    EFFECTS,
    RANGE_DPS,
    TOTAL,
    Cubic,
    Decay,
    FloatArray,
    Quintic,
    Ripple,
    Squared,
    Toy,
    ToyEffect,
    toy,
)

STEPS = np.arange(24) % 6 != 3


def fitted(problem: Toy, *effects: DescribedEffect) -> Fit:
    point = Point(baseline=problem.baseline_start, effects=effects)
    return fit(problem, NoiseModel.of(problem).plain, point, STEPS)


def probes(problem: Toy, kinds: Sequence[type[ToyEffect]] = tuple(EFFECTS.values())) -> list[Probe]:
    return [probe for kind in kinds for probe in probes_of(problem, kind)]


def screened(problem: Toy, kinds: Sequence[type[ToyEffect]] = tuple(EFFECTS.values())) -> Screening:
    return screen(problem, NoiseModel.of(problem).plain, fitted(problem), probes(problem, kinds), seed=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sizeless(ToyEffect):
    """A square as it stands: there is no less of it and no more."""

    order: float
    identifier: ClassVar[str] = "sizeless"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "order": Parameter(unit="1", meaning="order", low=2.0, high=2.0, role="choice", scan=(2.0,))
    }

    def column(self, problem: Toy) -> FloatArray:
        return 1e-3 * problem.share**2


@dataclass(frozen=True, slots=True, kw_only=True)
class Steeper(ToyEffect):
    """What the scale factor does already."""

    size_v: float
    identifier: ClassVar[str] = "steeper"
    parameters: ClassVar[Mapping[str, Parameter]] = Cubic.parameters

    def column(self, problem: Toy) -> FloatArray:
        return self.size_v * problem.share


@dataclass(frozen=True, slots=True, kw_only=True)
class Bursting(ToyEffect):
    size_v: float
    identifier: ClassVar[str] = "bursting"
    parameters: ClassVar[Mapping[str, Parameter]] = Cubic.parameters

    def column(self, problem: Toy) -> FloatArray:
        return np.full(TOTAL, math.inf if self.size_v > 0.0 else 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Wave(Ripple):
    """A ripple of one order."""

    identifier: ClassVar[str] = "wave"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        **Ripple.parameters,
        "order": replace(Ripple.parameters["order"], scan=(1.0,)),
    }


@pytest.mark.parametrize("truth", [Cubic(size_v=2e-3), Ripple(amplitude_v=3e-4, phase_deg=75.0, order=1.0)])
def test_a_score_is_what_a_fit_gains(truth: ToyEffect) -> None:
    problem = toy(truth)
    best = screened(problem).best_of_each()[0]
    start = best.probe.start(best.weights)
    assert start.identifier == truth.identifier
    assert best.gain == pytest.approx(gain_of(fitted(problem, start), fitted(problem)), rel=2e-3)


def test_the_weights_are_where_the_fit_ends() -> None:
    problem = toy(Ripple(amplitude_v=2e-3, phase_deg=75.0, order=2.0))
    best = screened(problem).best_of_each()[0]
    start = best.probe.start(best.weights)
    (ends,) = fitted(problem, start).point.effects
    assert start.values == pytest.approx(ends.values, rel=1e-3)


def test_the_right_shape_promises_most() -> None:
    problem = toy(Decay(amplitude_v=8e-3, tau_s=100.0))
    best = screened(problem).best_of_each()[0]
    assert best.probe.columns[0].values["tau_s"] == 100.0


def test_only_the_steps_that_were_fitted_are_scored() -> None:
    problem = toy()
    spoilt = replace(problem, measured=problem.measured + np.where(STEPS[problem.step], 0.0, problem.share**3))
    there, here = ([one.gain for one in screened(each).scored] for each in (spoilt, problem))
    assert there == pytest.approx(here, abs=1e-6)


def test_what_the_model_in_hand_can_follow_scores_nothing() -> None:
    (one,) = screened(toy(baseline=(0.03, 0.2)), [Steeper]).scored
    assert one.gain == 0.0
    assert one.power == pytest.approx([0.0])


def test_a_prediction_that_is_not_a_number_scores_nothing() -> None:
    (one,) = screened(toy(), [Bursting]).scored
    assert one.gain == 0.0


def test_of_an_effect_without_a_size_there_is_no_less_than_nothing() -> None:
    there = screened(toy(Sizeless(order=2.0)), [Sizeless]).scored[0]
    against = screened(toy(Squared(size_v=-1e-3)), [Sizeless]).scored[0]
    assert there.gain > 100.0
    assert there.weights == pytest.approx([1.0], abs=0.2)
    assert against.gain == 0.0


def test_the_power_says_how_well_a_size_is_known() -> None:
    problem = toy(Squared(size_v=2e-3))
    one = screened(problem, [Squared]).scored[0]
    result = fitted(problem, Squared(size_v=1e-4))
    error = math.sqrt(result.covariance[2, 2])
    # the residual still holds the effect, so the variance that the power is over is larger
    assert one.probe.sizes[0] / math.sqrt(one.power[0]) == pytest.approx(
        error * fitted(problem).deviation / result.deviation, rel=2e-3
    )


def test_places_are_paid_for() -> None:
    problem = toy(Squared(size_v=2e-3))
    plain = probes(problem, [Squared])
    chosen = [replace(plain[0], places=1e4)]
    free, paid = (
        screen(problem, NoiseModel.of(problem).plain, fitted(problem), which, seed=0).scored[0]
        for which in (plain, chosen)
    )
    assert free.promise - paid.promise == pytest.approx(2.0 * math.log(1e4))


def test_of_each_effect_the_best_place_is_taken_the_best_effect_first() -> None:
    best = screened(toy(Squared(size_v=2e-3), Decay(amplitude_v=2e-3, tau_s=100.0))).best_of_each()
    assert {one.probe.identifier for one in best} == set(EFFECTS)
    promises = [one.promise for one in best]
    assert promises == sorted(promises, reverse=True)


def test_without_a_probe_there_is_no_threshold_to_pass() -> None:
    nothing = screened(toy(), [])
    assert nothing.threshold == 0.0
    assert nothing.best_of_each() == []


@pytest.mark.parametrize(("kinds", "freedom"), [((Squared,), 1), ((Steeper, Squared), 1), ((Wave,), 2)])
def test_the_threshold_of_one_probe_is_that_of_chi_squared(kinds: tuple[type[ToyEffect], ...], freedom: int) -> None:
    thresholds = [
        screen(toy(), NoiseModel.of(toy()).plain, fitted(toy()), probes(toy(), kinds), seed=seed).threshold
        for seed in range(8)
    ]
    assert float(np.mean(thresholds)) == pytest.approx(chi2.ppf(0.999, freedom), abs=0.7)


def test_look_alikes_cost_less_than_effects_that_have_nothing_in_common() -> None:
    def threshold(*kinds: type[ToyEffect]) -> float:
        plain = NoiseModel.of(toy()).plain
        drawn = [screen(toy(), plain, fitted(toy()), probes(toy(), kinds), seed=seed).threshold for seed in range(8)]
        return float(np.mean(drawn))

    alike, apart = threshold(Cubic, Quintic), threshold(Cubic, Decay, Ripple)
    assert chi2.ppf(0.999, 1) - 0.5 < alike < apart < chi2.ppf(0.999, 2) + 5.0


@pytest.mark.slow
def test_the_threshold_is_what_white_noise_reaches_as_often_as_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """One time in ten here, so that a few hundred draws can count it; the draws are screened like any recording."""
    monkeypatch.setattr(screening, "_CHANCE", 0.1)
    reached = 0
    for seed in range(400):
        one = screened(toy(seed=seed))
        reached += max(each.gain for each in one.scored) > one.threshold
    # the binomial of 400 draws at 0.1 has a deviation of 6
    assert 19 <= reached <= 61


def test_where_noise_is_coloured_a_gain_counts_for_less() -> None:
    driven = np.random.default_rng(3).standard_normal(TOTAL)
    bright = scipy.signal.lfilter([1.0], [1.0, -0.9], driven)
    problem = toy(noise_v=0.0, added_v=1e-3 * bright + 2e-3 * (toy().share * RANGE_DPS / 100.0) ** 2)
    one = screened(problem, [Squared]).scored[0]
    assert one.gain > 20.0
    assert one.scatter > 2.0
    assert one.promise == pytest.approx(one.gain / one.scatter)


def test_how_many_probes_are_looked_at_together_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = toy(Cubic(size_v=2e-3), Ripple(amplitude_v=3e-4, phase_deg=75.0, order=1.0))
    together = screened(problem)
    monkeypatch.setattr(screening, "_BATCH", 1)
    alone = screened(problem)
    assert [one.gain for one in alone.scored] == pytest.approx([one.gain for one in together.scored], rel=1e-9)
    for one, other in zip(alone.scored, together.scored, strict=True):
        assert one.probe.identifier == other.probe.identifier
        assert one.weights == pytest.approx(other.weights, rel=1e-6, abs=1e-15)
        assert one.power == pytest.approx(other.power, rel=1e-9)
        assert one.scatter == pytest.approx(other.scatter, rel=1e-9)


def test_of_very_many_rows_some_say_how_alike_probes_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """The threshold is drawn, from 4000 draws: it scatters by about one."""
    plain, whole = NoiseModel.of(toy()).plain, fitted(toy())

    def mean_threshold() -> float:
        drawn = [screen(toy(), plain, whole, probes(toy()), seed=seed).threshold for seed in range(12)]
        return float(np.mean(drawn))

    of_all = mean_threshold()
    monkeypatch.setattr(screening, "_ROWS_ENOUGH", 500)
    assert mean_threshold() == pytest.approx(of_all, abs=1.0)
