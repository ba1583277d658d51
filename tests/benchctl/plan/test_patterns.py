import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl.plan import alternating, levels, rates_between_zeros, set_points, whole_cycles, whole_revolutions


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
