"""Scores, on answers whose rightness is plain."""

import pytest

from benchctl.proof.score import score_diagnosis, score_regression
from tests.benchctl.proof.made import finding, said, truth

LAG = {"thermal_lag": {"tau_s": 300.0}}
HEADING = {"heading_dependent_bias": {"amplitude_v": 1e-3, "phase_deg": 5.0, "order": 2.0}}


def test_exactly_what_was_drawn_is_right() -> None:
    score = score_diagnosis(truth("single", LAG), said(finding("thermal_lag", tau_s=(310.0, 295.0, 325.0))))
    assert score.right
    assert score.verdict_right
    assert score.heldout_ratio == pytest.approx(1.01)
    (tau,) = score.parameters
    assert tau.error == pytest.approx(1 / 30)
    assert tau.inside_ci95


@pytest.mark.parametrize(
    ("findings", "missed", "made_up"),
    [
        ([], ("thermal_lag",), ()),
        (["thermal_hysteresis"], ("thermal_lag",), ("thermal_hysteresis",)),
        (["thermal_lag", "warm_up"], (), ("warm_up",)),
    ],
)
def test_less_and_more_than_was_drawn_is_not(
    findings: list[str], missed: tuple[str, ...], made_up: tuple[str, ...]
) -> None:
    score = score_diagnosis(truth("single", LAG), said(*map(finding, findings)))
    assert (score.right, score.missed, score.made_up) == (False, missed, made_up)


def test_with_nothing_missing_no_finding_is_right_whatever_the_verdict_which_is_scored_apart() -> None:
    assert score_diagnosis(truth("nothing"), said(verdict="consistent")).right
    recalibrate = score_diagnosis(truth("nothing"), said(verdict="recalibrate"))
    assert recalibrate.right
    assert not recalibrate.verdict_right
    assert not score_diagnosis(truth("moved"), said(finding("warm_up"), verdict="missing-physics")).right


def test_phases_are_compared_around_the_circle_and_modulo_the_order() -> None:
    near = finding(
        "heading_dependent_bias", amplitude_v=(1.1e-3, 9e-4, 1.2e-3), phase_deg=(178.0, 170.0, 190.0), order=(2, 2, 2)
    )
    score = score_diagnosis(truth("single", HEADING), said(near))
    amplitude, phase, order = score.parameters
    assert phase.error == pytest.approx(0.07)  # 7° of a hundred
    assert phase.inside_ci95
    assert amplitude.within(0.25)
    assert not amplitude.within(0.05)
    assert order.error == 0.0


def test_another_order_is_as_wrong_as_can_be() -> None:
    stated = finding("heading_dependent_bias", order=(1.0, 1.0, 1.0))
    (order,) = score_diagnosis(truth("single", HEADING), said(stated)).parameters
    assert not order.within(1e9)
    assert not order.inside_ci95


OUTSIDER = truth("outsider", HEADING, withheld=("heading_dependent_bias", "encoder_eccentricity"), lives_in=("angle",))


@pytest.mark.parametrize(
    ("answer", "right", "located"),
    [
        (said(verdict="unknown-structure", where=("angle", "time")), True, True),
        (said(verdict="unknown-structure", where=("angle*gyro_temp",)), True, True),
        (said(verdict="unknown-structure", where=("time", "angle")), False, False),
        (said(finding("warm_up"), where=("angle",)), False, True),
        (said(verdict="consistent"), False, False),
    ],
)
def test_an_outsider_wants_unknown_structure_in_its_coordinate_and_no_name(
    answer: dict[str, object], right: bool, located: bool
) -> None:
    score = score_diagnosis(OUTSIDER, answer)
    assert (score.right, score.located) == (right, located)
    assert score.missed == ()


def test_the_regression_is_scored_alike_and_has_no_word_for_unknown_structure() -> None:
    told = {"effects": ["thermal_lag"], "heldout_ratio": 1.27}
    assert score_regression(truth("single", LAG), told).right
    assert score_regression(truth("pair", {**LAG, **HEADING}), told).missed == ("heading_dependent_bias",)
    assert not score_regression(OUTSIDER, {"effects": [], "heldout_ratio": 1.0}).right
