"""Findings: values with intervals that hold, odds against alternatives, and noise in its own units."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchctl.diagnosis.findings.findings import findings_of, noise_effects
from benchctl.diagnosis.result import Finding
from benchctl.diagnosis.search.select import select, without_nothing
from benchctl.diagnosis.search.selection import Evidence, Selection
from benchctl.estimation.fit import Fit
from benchctl.estimation.noise_model import GROWING, NoiseModel, Noisy
from benchctl.signals.normal import Z95
from tests.benchctl.diagnosis.toy_problem import (
    EFFECTS,
    NOISE_V,
    TOTAL,
    Decay,
    Ripple,
    Squared,
    Toy,
    ToyEffect,
    toy,
)

DECAY, SQUARED = Decay(amplitude_v=5e-3, tau_s=150.0), Squared(size_v=1e-3)
RIPPLE = Ripple(amplitude_v=5e-4, phase_deg=2.0, order=1.0)


def selected(problem: Toy) -> Selection:
    return select(problem, seed=0, progress=lambda _name, _share: None)


def found(*truth: ToyEffect, seed: int = 0) -> dict[str, Finding]:
    problem = toy(*truth, seed=seed)
    return {one.effect: one for one in findings_of(problem, selected(problem))}


def with_rivals(losses: dict[str, float]) -> Finding:
    problem = toy(SQUARED)
    chosen = selected(problem)
    evidence = replace(chosen.evidence["squared"], rivals=losses)
    (one,) = findings_of(problem, replace(chosen, evidence={"squared": evidence}))
    return one


def noisy(effect: str, size: float, log_error: float, chosen: Selection) -> Selection:
    one = Noisy(effect=effect, gain=40.0, size=size, log_error=log_error, whitener=chosen.whitener)
    return replace(chosen, noise=replace(chosen.noise, found={effect: one}))


@pytest.mark.slow
def test_the_intervals_hold_nineteen_times_of_twenty() -> None:
    truth = Decay(amplitude_v=5e-3, tau_s=150.0)
    inside = {"amplitude_v": 0, "tau_s": 0}
    for seed in range(100):
        # only the true effect is a hypothesis: it is the interval that is tried
        problem = toy(truth, seed=seed, hypotheses=[Decay])
        (one,) = findings_of(problem, selected(problem))
        for name, estimate in one.parameters.items():
            assert estimate.low < estimate.value < estimate.high
            inside[name] += estimate.low < truth.values[name] < estimate.high
    assert all(88 <= count <= 100 for count in inside.values()), inside


def test_an_effect_whose_size_the_recording_does_not_determine_is_no_finding() -> None:
    problem = toy(SQUARED)
    chosen = selected(problem)
    assert [*without_nothing(problem, chosen).evidence] == ["squared"]
    zero = np.zeros((len(chosen.full.numbers),) * 2)  # an error of zero: the derivative vanishes
    undetermined = replace(chosen, full=replace(chosen.full, disturbed_covariance=zero))
    assert not without_nothing(problem, undetermined).evidence


def test_values_intervals_and_units_are_those_of_the_fit_to_everything() -> None:
    problem = toy(DECAY, SQUARED)
    chosen = selected(problem)
    by_name = {one.effect: one for one in findings_of(problem, chosen)}
    errors = np.sqrt(np.diag(chosen.full.robust_covariance(problem.step)))
    for i, number in enumerate(chosen.full.numbers):
        if number.effect is None:
            continue
        effect = chosen.full.point.effects[number.effect]
        estimate = by_name[effect.identifier].parameters[number.name]
        assert estimate.value == effect.values[number.name]
        assert estimate.unit == effect.parameters[number.name].unit
        if effect.parameters[number.name].logarithmic:
            assert math.log(estimate.high / estimate.value) == pytest.approx(Z95 * errors[i])
            assert estimate.high / estimate.value == pytest.approx(estimate.value / estimate.low)
        else:
            assert estimate.high - estimate.value == pytest.approx(Z95 * errors[i])


def test_what_was_chosen_among_a_few_has_no_interval() -> None:
    order = found(RIPPLE)["ripple"].parameters["order"]
    assert (order.low, order.value, order.high) == (1.0, 1.0, 1.0)


def test_the_interval_of_a_phase_may_pass_a_whole_turn() -> None:
    phase = found(RIPPLE)["ripple"].parameters["phase_deg"]
    assert phase.high - phase.low > 1.0
    assert phase.low < 2.0 < phase.high or phase.low < 362.0 < phase.high


def test_no_interval_leaves_the_bounds_of_its_parameter() -> None:
    problem = toy(Decay(amplitude_v=20e-3, tau_s=9.9e3), hypotheses=[Decay])
    (one,) = findings_of(problem, selected(problem))
    assert one.parameters["tau_s"].high <= 1e4
    assert one.parameters["tau_s"].low >= 10.0


def test_each_finding_says_what_its_effect_says_and_where_it_lives() -> None:
    both = found(DECAY, SQUARED)
    assert set(both) == {"decay", "squared"}
    for name, one in both.items():
        assert one.says == f"There is {name}."
        assert one.where.coordinate == EFFECTS[name].coordinate
        assert len(one.where.steps) == 3
    # a decay is largest as the recording begins
    assert both["decay"].where.ranges[0][0] == pytest.approx(0.0)
    assert 0.8 <= both["decay"].where.share_of_excess <= 1.0
    assert both["decay"].where.steps[0] == "step 0"
    # a square at the largest rates
    assert both["squared"].where.ranges[-1][1] == pytest.approx(100.0, rel=0.05)


def test_what_each_explains_are_shares_of_one_whole() -> None:
    both = found(DECAY, Ripple(amplitude_v=4e-3, phase_deg=40.0, order=2.0))
    shares = [one.explains for one in both.values()]
    assert all(0.0 < share < 1.0 for share in shares)
    assert sum(shares) == pytest.approx(1.0, abs=0.1)
    assert found(DECAY)["decay"].explains == pytest.approx(1.0, abs=0.02)


def test_gains_are_those_of_the_evidence() -> None:
    problem = toy(DECAY)
    chosen = selected(problem)
    (one,) = findings_of(problem, chosen)
    assert (one.gain, one.gain_heldout) == (chosen.evidence["decay"].gain, chosen.evidence["decay"].heldout)


def test_odds_are_those_of_the_likelihoods() -> None:
    one = with_rivals({"far": 9.0, "near": 2.0})
    odds = {"near": math.exp(-1.0), "far": math.exp(-4.5)}
    whole = 1.0 + sum(odds.values())
    assert one.probability == pytest.approx(1.0 / whole)
    assert [other.effect for other in one.alternatives] == ["near", "far"]
    assert [other.probability for other in one.alternatives] == pytest.approx(
        [odds["near"] / whole, odds["far"] / whole]
    )
    assert [other.loss for other in one.alternatives] == [2.0, 9.0]


def test_a_rival_that_is_no_worse_is_as_probable_and_never_more() -> None:
    one = with_rivals({"twin": -3.0})
    assert one.probability == pytest.approx(0.5)
    assert one.alternatives[0].probability == pytest.approx(0.5)


def test_what_is_out_of_the_question_is_not_named() -> None:
    assert with_rivals({"hopeless": 50.0}).alternatives == ()
    assert with_rivals({"hopeless": 1e6}).probability == pytest.approx(1.0)
    assert with_rivals({}).probability == 1.0


def test_the_size_of_a_walk_is_in_volts() -> None:
    chosen = noisy("bias_random_walk", 0.02, 0.1, selected(toy()))
    (effect,) = noise_effects(chosen)
    assert effect.identifier == "bias_random_walk"
    assert effect.values["v_per_sqrt_s"] == pytest.approx(0.02 * NOISE_V, rel=0.05)
    (one,) = findings_of(toy(), chosen)
    size = one.parameters["v_per_sqrt_s"]
    assert math.log(size.high / size.value) == pytest.approx(Z95 * 0.1)
    assert one.gain == 40.0
    assert one.probability == pytest.approx(1.0)


def test_a_walk_that_may_be_flicker_says_so() -> None:
    chosen = noisy("bias_random_walk", 0.02, 0.1, selected(toy()))
    (walk,) = chosen.noise.found.values()
    open_model = replace(chosen.noise, found={walk.effect: replace(walk, rivals={"flicker_noise": 2.0})})
    (one,) = findings_of(toy(), replace(chosen, noise=open_model))
    assert [other.effect for other in one.alternatives] == ["flicker_noise"]
    assert one.probability == pytest.approx(1.0 / (1.0 + math.exp(-1.0)))


def test_noise_that_grows_is_named_by_its_factor_and_the_factor_s_own_error() -> None:
    growth, log_error = 8.0, 0.3
    chosen = noisy(GROWING, growth, log_error, selected(toy()))
    (one,) = findings_of(toy(), chosen)
    factor = one.parameters["factor_at_full_rate"]
    assert factor.value == pytest.approx(3.0)
    # d ln√(1 + g) = g/(2·(1 + g))·d ln g
    slope = (math.log(math.sqrt(1.0 + growth * 1.001)) - math.log(3.0)) / math.log(1.001)
    assert math.log(factor.high / factor.value) == pytest.approx(Z95 * log_error * slope, rel=1e-3)


def test_a_size_that_is_not_determined_has_an_interval_that_is_a_number() -> None:
    chosen = noisy("flicker_noise", 0.02, 1e9, selected(toy()))
    (one,) = findings_of(toy(), chosen)
    size = one.parameters["v_rms_per_decade"]
    assert math.isfinite(size.high)
    assert size.high > 1e6 * size.value


def test_where_nothing_was_chosen_there_is_no_finding() -> None:
    chosen = selected(toy())
    assert findings_of(toy(), chosen) == ()
    assert noise_effects(chosen) == ()
    assert isinstance(chosen.after, Fit)
    assert isinstance(chosen.noise, NoiseModel)
    assert not any(isinstance(one, Evidence) for one in chosen.evidence.values())
    assert chosen.after.residual.size == TOTAL
