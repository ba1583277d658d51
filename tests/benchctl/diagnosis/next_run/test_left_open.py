"""Which run is asked for: the one for what is open, and none where nothing is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.next_run import left_open
from benchctl.diagnosis.next_run.experiment import NOTHING_OPEN, OpenPair
from benchctl.diagnosis.next_run.left_open import next_of
from benchctl.diagnosis.next_run.sampled import SampleNoise
from benchctl.diagnosis.result import Alternative, Finding, NextExperiment, Unexplained, Where
from benchctl.diagnosis.search.select import select
from benchctl.diagnosis.search.selection import Evidence, Selection
from benchctl.estimation.noise import Noisy, walk
from benchctl.estimation.noise_model import NoiseModel
from benchctl.recordings.model import BenchFacts, Meta, Unit
from tests.benchctl.diagnosis.following import LATE, SMOOTH, fitted, problem_of
from tests.benchctl.diagnosis.moving import NOISE_V
from tests.benchctl.diagnosis.toy_problem import Cubic, toy

META = Meta(
    status="complete",
    unit=Unit(serial="G-1", range_dps=100.0),
    bench=BenchFacts(sample_rate_hz=100.0, encoder_counts_per_rev=4194304),
)
NOTHING = Unexplained(significant=False, share=0.0)
STRANGE = Unexplained(significant=True, share=0.4, coordinates=("acceleration",), says="odd")


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> GyroProblem:
    return problem_of(tmp_path_factory.mktemp("slow"))


@pytest.fixture(scope="module")
def chosen(problem: GyroProblem) -> Selection:
    """Late samples were found; a low-pass would do as well."""
    after = fitted(problem, LATE)
    rival = fitted(problem, SMOOTH)
    evidence = Evidence(
        gain=100.0,
        heldout=20.0,
        scatter=1.0,
        excess=np.zeros(problem.frame.rows, np.float32),
        rivals={"sensor_bandwidth": 0.5},
        nearest=rival.point,
    )
    return Selection(
        before=fitted(problem),
        after=after,
        full=after,
        noise=NoiseModel.of(problem),
        screening=select(toy(hypotheses=[]), seed=0, progress=lambda _name, _share: None).screening,
        evidence={"timing_offset": evidence},
        heldout=~after.fitted,
        least=20.0,
    )


def finding(*alternatives: str, effect: str = "timing_offset") -> Finding:
    return Finding(
        effect=effect,
        probability=0.6,
        parameters={},
        where=Where(coordinate="acceleration"),
        explains=0.5,
        gain=100.0,
        gain_heldout=20.0,
        says="late",
        alternatives=tuple(Alternative(effect=name, probability=0.4, loss=0.5) for name in alternatives),
    )


def asked(
    problem: Any, chosen: Selection, findings: Sequence[Finding], unexplained: Unexplained = NOTHING
) -> NextExperiment:
    return next_of(problem, chosen, findings, unexplained, META, lambda _name, _share: None)


def handed_on(
    monkeypatch: pytest.MonkeyPatch, problem: GyroProblem, chosen: Selection
) -> tuple[SampleNoise, list[OpenPair]]:
    """What the search for a run is given."""
    given: list[Any] = []

    def found(_problem: Any, noise: SampleNoise, pairs: list[OpenPair], **_: Any) -> NextExperiment:
        given.append((noise, pairs))
        return NextExperiment(says="this one")

    monkeypatch.setattr(left_open, "next_experiment", found)
    assert asked(problem, chosen, [finding("sensor_bandwidth")]).says == "this one"
    ((noise, pairs),) = given
    return noise, pairs


def test_a_finding_and_its_nearest_alternative_are_to_be_parted(
    monkeypatch: pytest.MonkeyPatch, problem: GyroProblem, chosen: Selection
) -> None:
    noise, (pair,) = handed_on(monkeypatch, problem, chosen)
    assert (pair.finding, pair.rival) == ("timing_offset", "sensor_bandwidth")
    assert pair.first is chosen.after
    assert [one.identifier for one in pair.second.point.effects] == ["sensor_bandwidth"]
    assert noise.white_v == pytest.approx(NOISE_V, rel=0.15)
    assert noise.walk_v_per_sqrt_s == 0.0


def test_a_walk_that_was_found_is_expected_in_the_next_run_too(
    monkeypatch: pytest.MonkeyPatch, problem: GyroProblem, chosen: Selection
) -> None:
    whitener = chosen.whitener.with_slow(walk(0.05, problem.interval_s))
    one = Noisy(effect="bias_random_walk", gain=40.0, size=0.05, log_error=0.1, whitener=whitener)
    noise, _ = handed_on(monkeypatch, problem, replace(chosen, noise=chosen.noise.with_(one)))
    assert noise.walk_v_per_sqrt_s == pytest.approx(0.05 * noise.white_v)
    assert noise.white_v == pytest.approx(chosen.after.deviation / whitener.innovation)


def test_how_a_bias_wanders_is_settled_by_rest(problem: GyroProblem, chosen: Selection) -> None:
    told = asked(problem, chosen, [finding("flicker_noise", effect="bias_random_walk")])
    assert told.separates == ("bias_random_walk", "flicker_noise")
    assert told.procedure == "static"


def test_where_a_finding_has_no_alternative_nothing_is_open(problem: GyroProblem, chosen: Selection) -> None:
    assert asked(problem, chosen, [finding()]) == NOTHING_OPEN
    assert asked(problem, chosen, []) == NOTHING_OPEN


def test_a_finding_that_was_not_chosen_by_likelihood_opens_nothing(problem: GyroProblem, chosen: Selection) -> None:
    fault = finding("dropouts", effect="outliers")
    assert asked(problem, chosen, [fault]) == NOTHING_OPEN
    alone = replace(chosen.evidence["timing_offset"], nearest=None)
    without = replace(chosen, evidence={"timing_offset": alone})
    assert asked(problem, without, [finding("sensor_bandwidth")]) == NOTHING_OPEN


def test_what_nobody_explains_is_repeated_along_its_coordinate(
    monkeypatch: pytest.MonkeyPatch, problem: GyroProblem, chosen: Selection
) -> None:
    coordinates: list[Sequence[str]] = []

    def repeated(_problem: Any, along: Sequence[str], **_: Any) -> NextExperiment:
        coordinates.append(along)
        return NextExperiment(says="again")

    monkeypatch.setattr(left_open, "repeat_along", repeated)
    assert asked(problem, chosen, [finding()], STRANGE).says == "again"
    assert coordinates == [("acceleration",)]


def test_for_a_part_without_procedures_of_its_own_it_is_said_what_to_record() -> None:
    other = toy(Cubic(size_v=5e-3))
    selection = select(other, seed=0, progress=lambda _name, _share: None)
    both = asked(other, selection, [finding("quintic", effect="cubic")], STRANGE)
    assert (
        both.says
        == "This recording does not separate cubic from quintic: record made up, and diagnose both recordings together."
    )
    assert both.separates == ("cubic", "quintic")
    assert "The unexplained part depends on acceleration" in asked(other, selection, [], STRANGE).says
    assert asked(other, selection, [], NOTHING) == NOTHING_OPEN
