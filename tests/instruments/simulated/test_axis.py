from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.table import TableParameters
from benchctl_instruments.simulated.axis import TableAxis
from benchctl_instruments.simulated.clock import MARGIN_S, Timebase, VirtualClock

STILL = TableParameters(ripple=0.0)


def enabled(parameters: TableParameters = STILL) -> tuple[VirtualClock, Timebase, TableAxis]:
    clock = VirtualClock()
    timebase = Timebase(clock, 2000.0)
    axis = TableAxis(timebase, parameters)
    axis.close_loop()
    return clock, timebase, axis


def test_a_rate_is_reached_after_its_ramp_and_held_for_hours() -> None:
    clock, _, axis = enabled()
    axis.demand_rate(100.0)
    clock.sleep(0.05)
    assert axis.motion().acceleration_dps2 == pytest.approx(2000.0, rel=0.05)
    clock.sleep(36_000.0)
    motion = axis.motion()
    assert motion.rate_dps == pytest.approx(100.0)
    # 0.05 s of ramp cost 2.5°
    assert motion.angle_deg == pytest.approx(100.0 * 36_000.05 - 2.5)


def test_an_angle_is_reached_and_held() -> None:
    clock, _, axis = enabled()
    axis.demand_angle(-725.0)
    clock.sleep(10.0)
    motion = axis.motion()
    assert (motion.angle_deg, motion.rate_dps) == pytest.approx((-725.0, 0.0), abs=1e-9)


def test_a_demand_takes_effect_at_the_next_instant_of_the_grid_and_the_last_one_holds() -> None:
    clock, _, axis = enabled()
    clock.sleep(1.00012)
    axis.demand_rate(50.0)
    axis.demand_rate(-50.0)
    before, after = axis.at(np.array([1.0004999, 1.001])).acceleration_dps2
    assert before == 0.0
    assert after < -100.0


def test_an_oscillation_is_about_the_present_angle() -> None:
    clock, _, axis = enabled()
    axis.demand_angle(30.0)
    clock.sleep(5.0)
    axis.demand_sine(10.0, 0.5, 0.0, 100.0)
    clock.sleep(20.0)
    angles = axis.at(25.0 - np.linspace(2.0, 0.0, 4001)).angle_deg
    assert (angles.min(), angles.max()) == pytest.approx((20.0, 40.0), abs=0.02)


def test_while_the_servo_is_off_demands_do_nothing() -> None:
    clock = VirtualClock()
    axis = TableAxis(Timebase(clock, 2000.0), replace(STILL, start_angle_deg=12.0))
    axis.demand_rate(50.0)
    axis.demand_angle(90.0)
    axis.demand_sine(1.0, 1.0, 0.0, 1.0)
    clock.sleep(10.0)
    assert (axis.motion().angle_deg, axis.motion().rate_dps) == (12.0, 0.0)


def test_with_the_servo_off_friction_stops_the_table() -> None:
    clock, _, axis = enabled()
    axis.demand_rate(60.0)
    clock.sleep(2.0)
    angle = axis.motion().angle_deg
    axis.open_loop()
    clock.sleep(0.1)
    assert axis.motion().acceleration_dps2 == -STILL.friction_dps2
    clock.sleep(10.0)
    motion = axis.motion()
    assert motion.rate_dps == 0.0
    assert motion.angle_deg - angle == pytest.approx(60.0**2 / (2.0 * STILL.friction_dps2), rel=1e-6)


def test_the_servo_catches_a_coasting_table() -> None:
    clock, _, axis = enabled()
    axis.demand_rate(200.0)
    clock.sleep(2.0)
    axis.open_loop()
    clock.sleep(0.1)
    axis.close_loop()
    clock.sleep(5.0)
    assert axis.motion().rate_dps == pytest.approx(0.0, abs=1e-9)
    angle = axis.motion().angle_deg
    clock.sleep(60.0)
    assert axis.motion().angle_deg == pytest.approx(angle, abs=1e-12)


def test_new_limits_hold_for_demands_from_then_on() -> None:
    clock, _, axis = enabled()
    axis.demand_rate(300.0)
    clock.sleep(2.0)
    axis.set_limits(100.0, 50.0)
    assert axis.limits() == (100.0, 50.0)
    assert axis.motion().rate_dps == pytest.approx(300.0)
    axis.demand_rate(300.0)
    clock.sleep(2.0)
    assert axis.motion().rate_dps == pytest.approx(200.0, rel=0.01)
    clock.sleep(60.0)
    assert axis.motion().rate_dps == pytest.approx(100.0)
    with pytest.raises(UsageError, match="above 0"):
        axis.set_limits(0.0, 50.0)


def test_what_was_not_held_is_forgotten_and_said_to_be() -> None:
    clock, timebase, axis = enabled()
    clock.sleep(10.0)
    timebase.held_since_s = 10.0
    for _ in range(3):
        axis.demand_rate(10.0)
        clock.sleep(1000.0)
    assert axis.at(np.array([10.0])).rate_dps[0] == pytest.approx(0.0)
    timebase.held_since_s = None
    axis.demand_rate(20.0)
    with pytest.raises(UsageError, match=r"motion at 10\.000 s is forgotten.* hold the history"):
        axis.at(np.array([10.0]))
    assert axis.at(np.array([clock.now() - MARGIN_S])).rate_dps[0] == pytest.approx(10.0)


def test_a_thousand_demands_leave_no_more_than_a_few_segments() -> None:
    clock, _, axis = enabled()
    for k in range(1000):
        axis.demand_angle(float(k % 7))
        clock.sleep(30.0)
    assert len(axis._segments) < 30


DEMANDS = st.one_of(
    st.tuples(st.just("demand_rate"), st.tuples(st.floats(-1000.0, 1000.0))),
    st.tuples(st.just("demand_angle"), st.tuples(st.floats(-1000.0, 1000.0))),
    st.tuples(
        st.just("demand_sine"),
        st.tuples(st.floats(0.01, 500.0), st.floats(0.05, 10.0), st.floats(-180.0, 180.0), st.floats(0.1, 5000.0)),
    ),
    st.tuples(st.sampled_from(["open_loop", "close_loop"]), st.just(())),
)


@given(sequence=st.lists(st.tuples(DEMANDS, st.floats(1e-4, 1.5)), min_size=1, max_size=8))
@settings(max_examples=60, deadline=None)
def test_no_sequence_of_demands_breaks_a_limit_or_makes_the_table_jump(
    sequence: list[tuple[tuple[str, tuple[float, ...]], float]],
) -> None:
    clock, timebase, axis = enabled()
    timebase.held_since_s = 0.0
    for (name, arguments), seconds in sequence:
        getattr(axis, name)(*arguments)
        clock.sleep(seconds)
    rate_limit, acceleration_limit = axis.limits()
    for segment in axis._segments:
        for tau in np.linspace(0.0, min(segment.piece.duration_s, 2.0), 60).tolist():
            _, rate, acceleration = segment.piece.at(tau)
            # a servo that catches a coasting table begins at the true rate, which may overshoot the demanded one
            assert abs(rate) <= rate_limit * 1.21
            assert abs(acceleration) <= acceleration_limit * (1 + 1e-9)
    times = np.arange(0.0, clock.now(), 1e-3)
    motion = axis.at(times)
    # between samples the angle is within its parabola, the rate within the greatest acceleration of the servo
    assert np.abs(motion.rate_dps).max() <= 1.25 * rate_limit
    assert np.abs(np.diff(motion.rate_dps)).max(initial=0.0) <= 4.0 * acceleration_limit * 1e-3
    step = np.diff(motion.angle_deg) - 1e-3 * 0.5 * (motion.rate_dps[1:] + motion.rate_dps[:-1])
    assert np.abs(step).max(initial=0.0) <= 4.0 * acceleration_limit * 1e-6
