"""The verdict in a word and in a sentence."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchctl.diagnosis.findings.findings import findings_of
from benchctl.diagnosis.findings.verdict import baseline_of, sentence_of, verdict_of
from benchctl.diagnosis.result import Estimate, Finding, Unexplained
from benchctl.diagnosis.search.select import select
from benchctl.diagnosis.search.selection import Selection
from benchctl.signals.normal import Z95
from tests.benchctl.diagnosis.toy_problem import K0, U0, Squared, Toy, toy

NOTHING = Unexplained(significant=False, share=0.0)
STRANGE = Unexplained(significant=True, share=0.4, coordinates=("angle",), says="Something lives in the angle.")


def selected(problem: Toy) -> Selection:
    return select(problem, seed=0, progress=lambda _name, _share: None)


def verdict(problem: Toy, unexplained: Unexplained = NOTHING) -> str:
    chosen = selected(problem)
    return verdict_of(problem, findings_of(problem, chosen), unexplained, baseline_of(problem, chosen))


def squared() -> tuple[Finding, ...]:
    problem = toy(Squared(size_v=2e-3))
    return findings_of(problem, selected(problem))


def moved(by: float, error: float, *, name: str = "K0_v_per_dps", was: float | None = K0) -> str:
    """The verdict where one parameter has moved by so much, with such a standard error."""
    value = K0 + by
    one = Estimate(value=value, low=value - Z95 * error, high=value + Z95 * error, unit="V", was=was)
    return verdict_of(toy(), (), NOTHING, {name: one})


def test_the_model_that_made_the_data_is_consistent_with_them() -> None:
    assert [verdict(toy(seed=seed)) for seed in range(20)] == ["consistent"] * 20


def test_a_scale_factor_that_has_moved_wants_recalibrating() -> None:
    assert verdict(toy(baseline=(1.003 * K0, U0))) == "recalibrate"
    assert verdict(toy(baseline=(K0, U0 + 3e-3))) == "recalibrate"


def test_missing_physics_comes_before_a_structure_and_that_before_a_moved_parameter() -> None:
    gone = toy(baseline=(1.01 * K0, U0))
    missing = replace(gone, measured=gone.measured + Squared(size_v=3e-3).column(gone))
    assert verdict(missing, STRANGE) == "missing-physics"
    assert verdict(gone, STRANGE) == "unknown-structure"
    assert verdict(gone) == "recalibrate"


@pytest.mark.parametrize(
    ("share", "errors", "word"),
    [(2e-4, 5.5, "recalibrate"), (2e-4, 4.5, "consistent"), (0.9e-4, 50.0, "consistent"), (-2e-4, 5.5, "recalibrate")],
)
def test_a_parameter_has_moved_where_that_is_sure_and_matters(share: float, errors: float, word: str) -> None:
    change = share * K0
    assert moved(change, abs(change) / errors) == word


def test_a_parameter_that_is_not_seen_has_not_moved() -> None:
    one = Estimate(value=1.1 * K0, low=-math.inf, high=math.inf, unit="V", was=K0)
    assert verdict_of(toy(), (), NOTHING, {"K0_v_per_dps": one}) == "consistent"


def test_where_no_lab_believed_in_anything_nothing_can_have_moved() -> None:
    assert moved(0.1 * K0, 1e-9, was=None) == "consistent"
    problem = replace(toy(baseline=(1.01 * K0, U0)), believed=False)
    assert all(one.was is None for one in baseline_of(problem, selected(problem)).values())
    assert verdict(problem) == "consistent"


def test_the_baseline_has_the_values_of_all_steps_with_intervals_and_what_was_believed() -> None:
    problem = toy(baseline=(1.003 * K0, U0))
    chosen = selected(problem)
    baseline = baseline_of(problem, chosen)
    errors = np.sqrt(np.diag(chosen.full.robust_covariance(problem.step)))
    assert list(baseline) == list(problem.baseline_names)
    assert [one.value for one in baseline.values()] == chosen.full.point.baseline.tolist()
    assert [one.high - one.low for one in baseline.values()] == pytest.approx((2.0 * Z95 * errors[:2]).tolist())
    assert [one.was for one in baseline.values()] == [K0, U0]
    assert [one.unit for one in baseline.values()] == list(problem.baseline_units)


def test_the_interval_of_the_baseline_holds() -> None:
    inside = 0
    for seed in range(60):
        problem = toy(seed=seed, hypotheses=[Squared])
        scale = baseline_of(problem, selected(problem))["K0_v_per_dps"]
        inside += scale.low < K0 < scale.high
    assert inside >= 52


def test_the_sentence_is_what_the_findings_say_and_what_is_left() -> None:
    found = squared()
    assert sentence_of("missing-physics", found, NOTHING) == "There is squared."
    assert sentence_of("missing-physics", found, STRANGE) == "There is squared. Something lives in the angle."
    assert sentence_of("unknown-structure", (), STRANGE) == "Something lives in the angle."


def test_where_nothing_is_missing_the_sentence_says_whether_parameters_moved() -> None:
    assert "recalibrate" in sentence_of("recalibrate", (), NOTHING)
    assert "agrees" in sentence_of("consistent", (), NOTHING)
