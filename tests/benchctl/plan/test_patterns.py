import math
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl.plan import (
    ConstantRate,
    Mount,
    PowerCycle,
    Sine,
    Static,
    Step,
    across,
    alternating,
    levels,
    rate_cycle,
    rates_between_zeros,
    set_points,
    slow_swing,
    small_steps,
    turn_ons,
    whole_cycles,
    whole_revolutions,
)
from benchctl.plan.patterns import ZERO_EVERY
from benchctl.plan.steps import positions


@given(rate_dps=st.floats(2.0, 500.0), at_least_s=st.floats(1.0, 600.0))
def test_a_run_takes_whole_revolutions_and_at_least_the_time_that_was_asked(rate_dps: float, at_least_s: float) -> None:
    seconds = whole_revolutions(rate_dps, at_least_s)
    turns = rate_dps * seconds / 360.0
    assert seconds >= at_least_s * (1 - 1e-9)
    assert turns == pytest.approx(round(turns), abs=1e-6)
    assert seconds - at_least_s <= 360.0 / rate_dps * (1 + 1e-9)


def test_a_rate_so_slow_that_a_turn_is_not_worth_waiting_for_runs_for_the_time_that_was_asked() -> None:
    assert whole_revolutions(0.5, 30.0) == 30.0
    assert whole_revolutions(0.0, 30.0) == 30.0


def test_both_directions_alternate_so_that_a_drift_is_no_asymmetry() -> None:
    assert alternating((1.0, 2.0)) == (1.0, -1.0, 2.0, -2.0)


def test_twenty_set_points_include_both_ends() -> None:
    points = set_points(-40.0, 60.0, 20)
    assert (len(points), points[0], points[-1]) == (20, -40.0, 60.0)
    assert set_points(-40.0, 60.0, 1) == (-40.0,)


def test_levels_end_at_the_top() -> None:
    assert levels(170.0, 17)[-1] == 170.0
    assert levels(170.0, 17)[0] == 10.0


@given(hz=st.floats(0.01, 50.0), at_least_s=st.floats(0.1, 100.0))
def test_sines_run_whole_periods(hz: float, at_least_s: float) -> None:
    cycles = whole_cycles(hz, at_least_s)
    assert cycles >= 1
    assert cycles / hz >= at_least_s * (1 - 1e-6)
    assert cycles == 1 or (cycles - 1) / hz < at_least_s


def test_zero_readings_stand_before_and_after_the_rates() -> None:
    steps = list(rates_between_zeros([10.0], at_least_s=30.0, zero_s=5.0))
    assert [step.kind for step in steps] == ["static", "constant_rate", "constant_rate", "static"]
    assert math.isclose(steps[1].streamed_s, 36.0)


def rates(steps: Iterable[Step]) -> list[float]:
    return [step.rate_dps if isinstance(step, ConstantRate) else 0.0 for step in steps]


def test_a_rate_cycle_goes_up_and_down_in_one_direction_and_then_in_the_other() -> None:
    turned = [rate for rate in rates(rate_cycle([10.0, 20.0, 30.0], at_least_s=30.0, zero_s=5.0)) if rate]
    assert turned == [10.0, 20.0, 30.0, 20.0, 10.0, -10.0, -20.0, -30.0, -20.0, -10.0]


@given(count=st.integers(1, 12))
def test_no_more_than_four_rates_of_a_cycle_stand_between_two_zeros(count: int) -> None:
    found = rates(rate_cycle(levels(100.0, count), at_least_s=1.0, zero_s=5.0))
    runs = "".join("0" if rate == 0.0 else "x" for rate in found)
    assert runs.startswith("0")
    assert runs.endswith("0")
    assert max(len(run) for run in runs.split("0")) <= ZERO_EVERY
    assert runs.count("x") == 2 * (2 * count - 1)


def test_the_rates_of_a_cycle_run_whole_revolutions() -> None:
    for step in rate_cycle([10.0, 20.0], at_least_s=30.0, zero_s=5.0):
        if isinstance(step, ConstantRate):
            turns = step.rate_dps * step.duration_s / 360.0
            assert turns == pytest.approx(round(turns))


def test_small_steps_stand_on_either_side_of_their_base_with_the_base_around_each() -> None:
    assert rates(small_steps(10.0, [0.1, 0.2], run_s=5.0)) == pytest.approx([10.0, 10.1, 9.9, 10.0, 10.2, 9.8, 10.0])
    about_rest = list(small_steps(0.0, [0.1], run_s=5.0))
    assert [step.kind for step in about_rest] == ["static", "constant_rate", "constant_rate", "static"]
    assert {step.streamed_s for step in about_rest} == {5.0}


def test_turn_ons_are_warm_before_their_sweep() -> None:
    found = list(turn_ons(iter([10.0, 20.0]), 3, off_s=60.0, warm_s=100.0, at_least_s=30.0, zero_s=5.0))
    once = ["power_cycle", "static", "static", *["constant_rate"] * 4, "static"]
    assert [step.kind for step in found] == once * 3  # also of rates that can be gone through only once
    assert (found[0], found[1]) == (PowerCycle(off_s=60.0), Static(duration_s=100.0))


def test_a_unit_mounted_across_is_mounted_along_again() -> None:
    found = list(across([50.0], at_least_s=30.0, zero_s=5.0))
    assert (found[0], found[-1]) == (Mount(position="across"), Mount(position="along"))
    assert rates(found[1:-1]) == [0.0, 50.0, -50.0, 0.0]
    assert set(positions(found[:-1])) == {"across"}


def test_a_slow_swing_is_a_sine() -> None:
    assert slow_swing(0.1, 0.01, 2) == Sine(amplitude_dps=0.1, frequency_hz=0.01, cycles=2)
