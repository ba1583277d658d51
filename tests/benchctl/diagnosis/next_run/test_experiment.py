"""The next experiment: what it promises, what it may propose, and that what it proposes can be run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.campaign.check import problems
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.next_run.candidates import candidates, shown_bench
from benchctl.diagnosis.next_run.experiment import (
    SETTLED,
    Expected,
    OpenPair,
    best_of,
    expected_separation,
    next_experiment,
)
from benchctl.diagnosis.next_run.planned import planned
from benchctl.diagnosis.next_run.sampled import SampleNoise
from benchctl.estimation.closest import known_from
from benchctl.plan import Sine, Static
from benchctl.plan.find import find_procedure
from benchctl.plan.written import as_texts
from benchctl_instruments.physics.effects.sensor_bandwidth import SensorBandwidth
from tests.benchctl.diagnosis.following import bench, pair_of, plan_of, problem_of
from tests.benchctl.diagnosis.moving import K0, NOISE_V

NOISE = SampleNoise(white_v=NOISE_V)


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> GyroProblem:
    return problem_of(tmp_path_factory.mktemp("slow"))


@pytest.fixture(scope="module")
def pair(problem: GyroProblem) -> OpenPair:
    return pair_of(problem)


def test_a_model_is_not_parted_from_itself(problem: GyroProblem, pair: OpenPair) -> None:
    rows = planned(plan_of(Static(duration_s=5.0), Sine(amplitude_dps=10.0, frequency_hz=8.0, cycles=100)), bench())
    assert expected_separation(problem, NOISE, pair.first, known_from(pair.first), rows) == pytest.approx(0.0, abs=1e-9)


def test_a_low_pass_whose_numbers_are_known_parts_from_a_delay_as_the_formula_says(
    problem: GyroProblem, pair: OpenPair
) -> None:
    hz, peak, cycles = 8.0, 10.0, 160
    rows = planned(plan_of(Sine(amplitude_dps=peak, frequency_hz=hz, cycles=cycles)), bench())
    certain = known_from(pair.second)
    certain = replace(certain, information=certain.information * 1e12)
    (smooth,), (late,) = pair.second.point.effects, pair.first.point.effects
    assert isinstance(smooth, SensorBandwidth)
    s = 1j * hz / smooth.cutoff_hz
    gain = (1 / (1 + np.sqrt(2.0) * s + s * s)) * pair.second.point.baseline[0] / K0
    delay = np.exp(-2j * np.pi * hz * late.values["offset_s"]) * pair.first.point.baseline[0] / K0
    power = 0.5 * (K0 * peak * abs(gain - delay)) ** 2 / NOISE_V**2
    bias = (pair.second.point.baseline[1] - pair.first.point.baseline[1]) ** 2 / NOISE_V**2
    promised = expected_separation(problem, NOISE, pair.first, certain, rows)
    assert promised == pytest.approx((power + bias) * cycles / hz * 100.0, rel=0.02)


def test_slow_motion_does_not_part_a_delay_from_a_low_pass(problem: GyroProblem, pair: OpenPair) -> None:
    rows = planned(plan_of(Sine(amplitude_dps=100.0, frequency_hz=0.3, cycles=60)), bench())
    assert expected_separation(problem, NOISE, pair.first, known_from(pair.second), rows) < 0.2


@settings(max_examples=8, deadline=None)
@given(hz=st.sampled_from([4.0, 7.0, 9.0]), cycles=st.integers(30, 200), times=st.integers(2, 6))
def test_what_is_promised_grows_with_the_duration(
    problem: GyroProblem, pair: OpenPair, hz: float, cycles: int, times: int
) -> None:
    known = known_from(pair.second)

    def promised(count: int) -> float:
        rows = planned(plan_of(Sine(amplitude_dps=10.0, frequency_hz=hz, cycles=count)), bench())
        return expected_separation(problem, NOISE, pair.first, known, rows)

    short, long = promised(cycles), promised(times * cycles)
    assert short < long <= times * short * 1.1


def test_one_frequency_alone_parts_nothing_where_the_scale_factor_is_not_known(
    problem: GyroProblem, pair: OpenPair
) -> None:
    rows = planned(plan_of(Sine(amplitude_dps=10.0, frequency_hz=9.0, cycles=900)), bench())
    known = known_from(pair.second)
    free = replace(known, information=0.0 * known.information)
    assert expected_separation(problem, NOISE, pair.first, free, rows) < 1.0
    assert expected_separation(problem, NOISE, pair.first, known, rows) > 20.0


def test_noise_divides_it(problem: GyroProblem, pair: OpenPair) -> None:
    rows = planned(plan_of(Sine(amplitude_dps=10.0, frequency_hz=9.0, cycles=900)), bench())
    certain = known_from(pair.second)
    certain = replace(certain, information=certain.information * 1e12)
    quiet, loud = (
        expected_separation(problem, SampleNoise(white_v=volts), pair.first, certain, rows) for volts in (2e-4, 4e-4)
    )
    assert quiet == pytest.approx(4.0 * loud, rel=1e-3)


@settings(max_examples=6, deadline=None)
@given(
    rate=st.floats(5.0, 300.0),
    acceleration=st.floats(20.0, 3000.0),
    coldest=st.floats(-60.0, 20.0),
    hottest=st.floats(26.0, 90.0),
    ramp=st.floats(0.2, 5.0),
)
def test_nothing_is_considered_that_the_bench_may_not_do(
    rate: float, acceleration: float, coldest: float, hottest: float, ramp: float
) -> None:
    stands = bench(
        rate_dps=rate, acceleration_dps2=acceleration, coldest_c=coldest, hottest_c=hottest, ramp_c_per_min=ramp
    )
    considered = list(candidates(stands))
    assert {plan.procedure for _, plan in considered} >= {"static", "sine_sweep", "diagnostic", "rate_sweep"}
    for told, plan in considered:
        again = find_procedure(plan.procedure).expand(as_texts(told))
        assert again.steps == plan.steps
        assert problems(again, stands) == []
        assert max(step.peak_rate_dps for step in again.steps) <= rate
        assert max(step.peak_acceleration_dps2 for step in again.steps) <= acceleration


def test_the_run_that_is_proposed_is_fast_enough_and_can_be_run(problem: GyroProblem, pair: OpenPair) -> None:
    stands = bench(acceleration_dps2=600.0)
    told = next_experiment(problem, NOISE, [pair], bench=stands)
    assert told.separates == ("timing_offset", "sensor_bandwidth")
    assert told.separation is not None
    assert told.separation >= SETTLED
    assert told.says.startswith(f"Run `{told.procedure}` with ")
    assert "it is expected to separate timing_offset from sensor_bandwidth by about " in told.says
    plan = find_procedure(told.procedure).expand(as_texts(told.parameters))
    assert problems(plan, stands) == []
    assert max(step.frequency_hz for step in plan.steps if isinstance(step, Sine)) > 4.0


def test_it_is_the_same_run_each_time(problem: GyroProblem, pair: OpenPair) -> None:
    assert next_experiment(problem, NOISE, [pair], bench=bench()) == next_experiment(
        problem, NOISE, [pair], bench=bench()
    )


def test_without_a_bench_it_is_kept_to_what_the_recording_shows(problem: GyroProblem, pair: OpenPair) -> None:
    shown = shown_bench(problem)
    assert shown.limits.rate_dps == pytest.approx(60.0, rel=0.01)
    assert shown.limits.acceleration_dps2 == pytest.approx(60.0 * 2 * np.pi * 0.5, rel=0.01)
    assert shown.limits.coldest_c < shown.limits.hottest_c < shown.limits.coldest_c + 3.0
    told = next_experiment(problem, NOISE, [pair])
    if told.procedure:
        assert problems(find_procedure(told.procedure).expand(as_texts(told.parameters)), shown) == []


def test_where_no_run_would_tell_none_is_proposed(problem: GyroProblem, pair: OpenPair) -> None:
    same = OpenPair(finding="timing_offset", rival="timing_offset", first=pair.first, second=pair.first)
    told = next_experiment(problem, NOISE, [same], bench=bench())
    assert (told.procedure, told.separation) == ("", None)
    assert "is expected to separate them" in told.says


def test_where_nothing_is_open_nothing_is_proposed(problem: GyroProblem) -> None:
    told = next_experiment(problem, NOISE, [])
    assert (told.says, told.procedure) == ("No further experiment is needed to separate the candidates.", "")


@given(st.lists(st.tuples(st.floats(0.1, 20.0), st.floats(0.0, 500.0), st.floats(0.0, 500.0)), min_size=1, max_size=8))
def test_the_quickest_run_that_settles_everything_wins_and_else_the_one_that_settles_most(
    drawn: list[tuple[float, float, float]],
) -> None:
    plan = plan_of(Static(duration_s=1.0))
    tried = [Expected(given={}, plan=plan, hours=hours, separations=(one, other)) for hours, one, other in drawn]
    best = best_of(tried)
    assert best is not None
    settling = [one.hours for one in tried if one.settles]
    if settling:
        assert best.settles
        assert best.hours == min(settling)
    else:
        assert best.worth == max(one.worth for one in tried)


def test_a_plan_that_was_written_down_is_the_plan_that_was_proposed(
    problem: GyroProblem, pair: OpenPair, tmp_path: Path
) -> None:
    from benchctl.plan.written import plan_source

    told = next_experiment(problem, NOISE, [pair], bench=bench())
    plan = find_procedure(told.procedure).expand(as_texts(told.parameters))
    (tmp_path / "next.py").write_text(plan_source(plan, told.says), encoding="utf-8")
    written = find_procedure(str(tmp_path / "next.py")).expand()
    assert written.steps == plan.steps
    assert problems(written, bench()) == []
