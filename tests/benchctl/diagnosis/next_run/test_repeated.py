"""The next experiment where no known effect is in question: an unknown structure, a bias that wanders."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from benchctl.campaign.check import problems
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.next_run.repeated import repeat_along, rest_longer
from benchctl.plan import ConstantRate, Plan, Sine, Step, ThermalRamp
from benchctl.plan.find import find_procedure
from benchctl.plan.written import as_texts
from tests.benchctl.diagnosis.following import bench, problem_of

_WITHOUT_A_VALUE = ("output", "step")


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> GyroProblem:
    return problem_of(tmp_path_factory.mktemp("slow"))


def _proposed(problem: GyroProblem, coordinate: str) -> Plan:
    told = repeat_along(problem, (coordinate,), bench=bench())
    assert f"depends on {coordinate}" in told.says
    assert told.separates == ()
    plan = find_procedure(told.procedure).expand(as_texts(told.parameters))
    assert problems(plan, bench()) == []
    return plan


@pytest.mark.parametrize(
    ("coordinate", "kind"),
    [
        ("gyro_temp_rate", ThermalRamp),
        ("rate*gyro_temp", ThermalRamp),
        ("acceleration", Sine),
        ("rate", Sine | ConstantRate),
    ],
)
@pytest.mark.slow
def test_the_run_moves_what_the_unknown_lives_along(problem: GyroProblem, coordinate: str, kind: type) -> None:
    assert any(isinstance(step, kind) for step in _proposed(problem, coordinate).steps)


def test_for_an_angle_the_table_is_turned_through_all_of_them(problem: GyroProblem) -> None:
    def reach_deg(step: Step) -> float:
        if isinstance(step, Sine):
            return step.amplitude_dps / (math.pi * step.frequency_hz)
        return abs(step.rate_dps) * step.duration_s if isinstance(step, ConstantRate) else 0.0

    assert max(reach_deg(step) for step in _proposed(problem, "angle").steps) > 360.0


@pytest.mark.parametrize("coordinate", _WITHOUT_A_VALUE)
@pytest.mark.slow
def test_there_is_an_answer_for_every_coordinate(problem: GyroProblem, coordinate: str) -> None:
    assert repeat_along(problem, (coordinate,), bench=bench(hottest_c=30.0, coldest_c=15.0)).says


def test_without_a_coordinate_the_recording_itself_is_to_be_repeated(problem: GyroProblem) -> None:
    told = repeat_along(problem, ())
    assert told.procedure == ""
    assert "repeat the recording" in told.says


def test_how_a_bias_wanders_is_told_by_a_long_rest(problem: GyroProblem) -> None:
    told = rest_longer(problem, ("bias_random_walk", "flicker_noise"), bench=bench())
    assert (told.procedure, told.separates) == ("static", ("bias_random_walk", "flicker_noise"))
    plan = find_procedure("static").expand(as_texts(told.parameters))
    assert max(step.streamed_s for step in plan.steps) >= 4 * 3600.0


def test_a_bench_that_may_not_hold_a_temperature_is_not_asked_to(problem: GyroProblem, tmp_path: Path) -> None:
    stands = bench(coldest_c=22.9, hottest_c=23.1)
    told = repeat_along(problem, ("gyro_temp_rate",), bench=stands)
    if told.procedure:
        assert problems(find_procedure(told.procedure).expand(as_texts(told.parameters)), stands) == []
