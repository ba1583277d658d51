"""The procedure that brings every effect out."""

import math

import pytest

from benchctl.bench import load_bench
from benchctl.campaign.check import problems
from benchctl.plan import ConstantRate, Plan, Sine, Soak, Static, ThermalRamp
from benchctl.plan.find import find_procedure
from benchctl_instruments.errors import UsageError


def plan(**texts: str) -> Plan:
    return find_procedure("diagnostic").expand(texts)


def test_the_simulated_bench_can_run_it_as_it_stands() -> None:
    assert problems(plan(), load_bench("simulated")) == []


def test_at_every_set_point_it_rests_turns_both_ways_and_swings_from_slow_to_fast() -> None:
    steps = plan(set_points_c="23,50").steps
    ramp = next(i for i, step in enumerate(steps) if isinstance(step, ThermalRamp))
    for block in (steps[:ramp], steps[ramp + 1 :]):
        rates = [step.rate_dps for step in block if isinstance(step, ConstantRate)]
        assert sorted(rates) == sorted(-rate for rate in rates)
        assert max(rates) == 170.0
        assert [step.frequency_hz for step in block if isinstance(step, Sine)] == [0.15, 0.5, 1.5, 4.0, 9.0]
        assert [step.duration_s for step in block if isinstance(step, Static)] == [40.0, 5.0]


def test_neither_direction_follows_the_clock() -> None:
    steps = plan().steps
    ramps = [i for i, step in enumerate(steps) if isinstance(step, ThermalRamp)]
    firsts = [next(step.rate_dps for step in steps[i:] if isinstance(step, ConstantRate)) for i in [0, *ramps]]
    assert [math.copysign(1, rate) for rate in firsts] == [1, -1, 1, -1, 1]


def test_the_ramps_join_the_set_points_with_the_table_swinging() -> None:
    ramps = [step for step in plan(ramp_c_per_min="1.5").steps if isinstance(step, ThermalRamp)]
    assert [(ramp.from_c, ramp.to_c) for ramp in ramps] == [(23, 50), (50, 10), (10, -30), (-30, 23)]
    assert {(ramp.swing_dps, ramp.swing_hz, ramp.rate_dps) for ramp in ramps} == {(45.0, 0.2, 0.0)}
    assert ramps[0].streamed_s == pytest.approx(27 / 1.5 * 60)


def test_sines_stay_within_rate_and_acceleration() -> None:
    for step in plan(top_rate_dps="100", acceleration_dps2="300").steps:
        if isinstance(step, Sine):
            assert step.peak_rate_dps <= 97.0
            assert step.peak_acceleration_dps2 <= 300.0 * (1 + 1e-9)
            assert step.streamed_s >= 8.0


def test_a_soak_comes_first_only_where_it_is_asked_for() -> None:
    assert not any(isinstance(step, Soak) for step in plan().steps)
    assert plan(soak_s="900").steps[0] == Soak(setpoint_c=23.0, hold_s=900.0)


def test_a_parameter_that_it_does_not_have_is_named() -> None:
    with pytest.raises(UsageError, match="procedure diagnostic has no parameter 'top_rate'"):
        plan(top_rate="100")
