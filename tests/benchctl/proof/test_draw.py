"""What trials conceal is drawn by chance, fits its class, and is the same for the same seed."""

from dataclasses import replace

import pytest

from benchctl.campaign.check import problems
from benchctl.proof.classes import CLASSES, FAINT_GAIN, ClassName
from benchctl.proof.draw import LEAST_GAIN, OUTSIDERS, draw, plan_of
from benchctl.proof.planned import planned
from benchctl.proof.sizes import STATISTICAL, WANDERING
from benchctl_instruments.physics.effects.registry import effects

QUICK = ("nothing", "moved", "single", "pair", "wandering", "outsider", "structure")


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=[] if kind in QUICK else pytest.mark.slow) for kind in CLASSES]
)
def test_a_trial_conceals_what_its_class_says(kind: ClassName) -> None:
    wanted = CLASSES[kind]
    for index in range(2):
        truth = draw(11, index, kind)
        so_many = len(truth.effects) - wanted.effects - wanted.wandering
        assert so_many in ((1, 2) if wanted.structure else (0,))
        assert bool(set(truth.effects) & set(WANDERING)) >= wanted.wandering
        assert truth.verdict == wanted.verdict
        if wanted.share is None:
            assert truth.gain == pytest.approx(FAINT_GAIN, rel=0.05)
        elif truth.gain is not None:
            assert truth.gain >= LEAST_GAIN


@pytest.mark.slow
def test_a_faint_effect_is_within_the_bounds_of_its_parameters() -> None:
    truth = draw(6, 108, "faint")  # first drawn: a lag, which at its least second is worth more than a faint one
    assert truth.gain == pytest.approx(FAINT_GAIN, rel=0.05)
    assert truth.made()


@pytest.mark.slow
def test_beside_a_wandering_bias_an_effect_is_worth_what_a_faint_one_is_alone() -> None:
    for index in range(4):
        truth = draw(12, index, "wandering+one")
        wandering = {name: size for name, size in truth.effects.items() if name in WANDERING}
        other = {name: size for name, size in truth.effects.items() if name not in STATISTICAL}
        if other:
            run = planned(plan_of(truth.unit), truth.unit)
            assert run.gain(replace(truth, effects=other).made(), wandering) >= FAINT_GAIN


def test_the_same_seed_and_number_seal_the_same_and_others_seal_others() -> None:
    digests = [draw(seed, index, "single").digest() for seed, index in ((1, 5), (1, 5), (1, 6), (2, 5))]
    assert digests[0] == digests[1]
    assert len(set(digests)) == 3


def test_with_nothing_missing_the_lab_believes_in_the_unit_as_it_is_and_with_coefficients_moved_it_does_not() -> None:
    for index in range(3):
        as_it_is, moved = draw(3, index, "nothing").unit, draw(3, index, "moved").unit
        for unit, far in ((as_it_is, False), (moved, True)):
            off = abs(unit.belief.K0_v_per_dps / unit.gyro.K0_v_per_dps - 1.0)
            assert (off > 1e-3) == far
            assert off < 0.03


@pytest.mark.parametrize(("effect", "term"), [("rate_nonlinearity", "k_omega"), ("scale_temperature", "k_T")])
def test_a_term_that_is_missing_is_missing_in_the_labs_model_and_in_the_unit_beside_the_effect(
    effect: str, term: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchctl.proof.draw.DRAWN", (effect,))
    unit = draw(4, 0, "single").unit
    assert getattr(unit.belief, term) == ()
    assert unit.gyro.g1_per_c == 0.0 or term == "k_omega"
    assert unit.gyro.S_rad_per_dps < 1e-5 or term == "k_T"


def test_of_an_outsider_the_own_hypothesis_is_withheld_and_nothing_is_left_to_name() -> None:
    truth = draw(5, 0, "outsider")
    (name,) = truth.effects
    assert name in truth.withheld
    assert truth.nameable == frozenset()
    assert truth.lives_in == OUTSIDERS[name][1]
    for outsider, (look_alikes, _) in OUTSIDERS.items():
        assert {outsider, *look_alikes} <= set(effects())


def test_the_sealed_bench_may_run_its_procedure_for_as_many_rows_as_recordings_have() -> None:
    for index in range(3):
        unit = draw(6, index, "nothing").unit
        plan = plan_of(unit)
        assert problems(plan, unit.public_bench()) == []
        rows = sum(step.streamed_s for step in plan.steps) * unit.sample_rate_hz
        assert 300_000 <= rows <= 500_000


def test_the_public_bench_says_nothing_of_what_is_concealed() -> None:
    truth = draw(7, 0, "triple")
    told = truth.unit.public_bench().model_dump_json()
    assert not any(name in told for name in truth.effects)
    assert truth.unit.public_bench().physics == {}
    assert truth.sealed_bench().effects.keys() == truth.effects.keys()
