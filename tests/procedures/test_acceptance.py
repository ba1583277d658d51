"""The procedures that an acceptance needs: all of them run on the simulated bench as they stand."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from benchctl.bench import load_bench
from benchctl.campaign.check import problems
from benchctl.plan import ConstantRate, Mount, Plan, PowerCycle, Sine, Soak, Static, ThermalRamp
from benchctl.plan.find import find_procedure
from benchctl_instruments.errors import UsageError

NAMES = (
    "acceptance",
    "hysteresis",
    "misalignment",
    "repeatability",
    "small_rates",
    "thermal_hysteresis",
    "thermal_ramps",
    "warm_up",
)


def plan(name: str, **texts: str) -> Plan:
    return find_procedure(name).expand(texts)


@pytest.mark.parametrize("name", NAMES)
def test_the_simulated_bench_can_run_it_as_it_stands(name: str) -> None:
    assert problems(plan(name), load_bench("simulated")) == []
    assert not plan(name).calibrates


@pytest.mark.parametrize("name", NAMES)
def test_it_says_what_it_measures_and_what_its_parameters_are(name: str) -> None:
    found = find_procedure(name)
    assert len(found.says) > 30
    for parameter in found.parameters:
        assert parameter.says, parameter.name


def test_the_acceptance_turns_the_unit_on_first_and_remounts_it_last() -> None:
    steps = plan("acceptance").steps
    assert [step.kind for step in steps[:3]] == ["soak", "power_cycle", "static"]
    assert steps[-1] == Mount(position="along")
    across = [number for number, step in enumerate(steps) if isinstance(step, Mount)]
    assert len(across) == 2
    assert not any(isinstance(step, Soak | PowerCycle | ThermalRamp) for step in steps[across[0] :])


def test_an_acceptance_without_an_operator_or_without_ramps_can_be_asked_for() -> None:
    bare = plan("acceptance", mount_across="no", ramp_c_per_min="0").steps
    assert not any(isinstance(step, Mount | ThermalRamp) for step in bare)
    assert len(bare) < len(plan("acceptance").steps)


def test_set_points_are_reached_by_heating_and_by_cooling_but_for_the_ends() -> None:
    for name in ("acceptance", "thermal_hysteresis"):
        soaks = [step.setpoint_c for step in plan(name).steps if isinstance(step, Soak)]
        upward = [-40.0, -20.0, 0.0, 20.0, 40.0, 60.0]
        first = soaks.index(-40.0)
        assert soaks[first : first + 10] == [*upward, 40.0, 20.0, 0.0, -20.0]


def test_every_rate_of_the_other_temperatures_is_one_of_the_sweep() -> None:
    """Sensitivities are by the rates that both have."""
    steps = plan("acceptance").steps
    first = next(i for i, step in enumerate(steps) if isinstance(step, PowerCycle) and i > 5)
    sweep = {step.rate_dps for step in steps[:first] if isinstance(step, ConstantRate)}
    last = next(i for i, step in enumerate(steps) if isinstance(step, ThermalRamp))
    others = {step.rate_dps for step in steps[first:last] if isinstance(step, ConstantRate)}
    assert len(others) == 10
    assert others <= sweep


def test_the_sines_of_an_acceptance_stay_within_rate_and_acceleration() -> None:
    sines = [step for step in plan("acceptance").steps if isinstance(step, Sine) and step.frequency_hz > 0.1]
    assert [step.frequency_hz for step in sines] == [0.5, 1.0, 2.0, 4.0, 8.0, 16.0]
    for step in sines:
        assert step.peak_acceleration_dps2 <= 800.0 * (1 + 1e-9)
        assert step.streamed_s >= 30.0 - 1e-9
        assert step.amplitude_dps == pytest.approx(min(step.amplitude_dps, 800.0 / (2 * math.pi * step.frequency_hz)))


def test_a_hysteresis_cycle_visits_every_rate_twice_but_the_top() -> None:
    turned = [step.rate_dps for step in plan("hysteresis").steps if isinstance(step, ConstantRate)]
    for rate in range(17, 170, 17):
        assert sum(math.isclose(one, rate) for one in turned) == 2
        assert sum(math.isclose(one, -rate) for one in turned) == 2
    assert turned.count(170.0) == turned.count(-170.0) == 1


def test_repeatability_has_as_many_turn_ons_as_were_asked_for() -> None:
    steps = plan("repeatability", cycles="4").steps
    assert sum(isinstance(step, PowerCycle) for step in steps) == 4
    for on, rest in pairwise(steps):
        if isinstance(on, PowerCycle):
            assert rest == Static(duration_s=1800.0)


def test_warm_up_is_looked_at_from_the_moment_of_the_turn_on() -> None:
    for name in ("warm_up", "acceptance"):
        steps = plan(name).steps
        first = next(i for i, step in enumerate(steps) if isinstance(step, PowerCycle))
        rest = steps[first + 1]
        assert isinstance(rest, Static)
        assert rest.settle_s == 0.0
        assert rest.duration_s >= 1800.0


def test_thermal_ramps_go_up_and_down_between_the_same_ends() -> None:
    up, down = (step for step in plan("thermal_ramps").steps if isinstance(step, ThermalRamp))
    assert (up.from_c, up.to_c, down.from_c, down.to_c) == (0.0, 40.0, 40.0, 0.0)
    assert up.rate_dps == up.swing_dps == 0.0


def test_small_rates_are_tried_about_rest_and_about_a_rate() -> None:
    turned = {round(step.rate_dps, 6) for step in plan("small_rates").steps if isinstance(step, ConstantRate)}
    for step_dps in (0.002, 0.005, 0.01, 0.02, 0.05):
        assert {step_dps, -step_dps, 10.0 + step_dps, 10.0 - step_dps} <= turned


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("parameter", "text"), [("run_s", "-1"), ("zero_s", "0"), ("soak_s", "-5")], ids=lambda one: str(one)
)
def test_a_parameter_that_no_bench_can_do_is_refused(name: str, parameter: str, text: str) -> None:
    known = {one.name for one in find_procedure(name).parameters}
    if parameter not in known:
        pytest.skip(f"{name} has no {parameter}")
    with pytest.raises(UsageError, match=f"parameter {parameter}: expected .*, got {text}"):
        plan(name, **{parameter: text})
