from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl_instruments.rate_tables.constant_rate_table import SHORTEST_S, ProvenAcceleration
from tests.instruments.table_machine import CountedClock

READ = st.tuples(st.floats(0.0, 0.2), st.floats(0.0, 0.2), st.floats(0.0, 0.2), st.floats(-0.05, 0.05))


def test_the_first_read_proves_nothing_and_the_second_the_mean_between_them() -> None:
    clock = CountedClock()
    proven = ProvenAcceleration(clock, rate_error_dps=0.05)
    assert math.isnan(proven.of(10.0, clock.now()))
    clock.sleep(0.1)
    assert proven.of(110.1, clock.now()) == pytest.approx(1000.0)
    clock.sleep(0.5)
    assert proven.of(10.0, clock.now()) == pytest.approx(-200.0)


def test_noise_of_a_table_at_rest_is_no_acceleration() -> None:
    clock = CountedClock()
    proven = ProvenAcceleration(clock, rate_error_dps=0.05)
    proven.of(0.05, clock.now())
    clock.sleep(0.05)
    assert proven.of(-0.05, clock.now()) == 0.0


def test_reads_at_one_instant_are_not_compared_and_hide_nothing() -> None:
    clock = CountedClock()
    proven = ProvenAcceleration(clock, rate_error_dps=0.0)
    proven.of(0.0, clock.now())
    clock.sleep(0.03)
    assert math.isnan(proven.of(60.0, clock.now()))
    clock.sleep(0.03)
    assert proven.of(60.0, clock.now()) == pytest.approx(1000.0)
    assert math.isnan(proven.of(60.0, clock.now()))


def test_after_forgetting_the_next_read_is_the_first_one() -> None:
    clock = CountedClock()
    proven = ProvenAcceleration(clock, rate_error_dps=0.0)
    proven.of(0.0, clock.now())
    clock.sleep(1.0)
    proven.forget()
    assert math.isnan(proven.of(100.0, clock.now()))


@given(reads=st.lists(READ, min_size=2, max_size=30), acceleration_dps2=st.floats(-3000.0, 3000.0))
def test_however_slow_the_line_no_more_is_stated_than_the_table_did(
    reads: list[tuple[float, float, float, float]], acceleration_dps2: float
) -> None:
    """Each read comes after a pause, its rate is measured at some time and answered later, and is off by something."""
    clock = CountedClock()
    proven = ProvenAcceleration(clock, rate_error_dps=0.05)
    for pause_s, measured_after_s, answered_after_s, error_dps in reads:
        clock.sleep(pause_s)
        asked_s = clock.now()
        clock.sleep(measured_after_s)
        rate_dps = acceleration_dps2 * clock.now() + error_dps
        clock.sleep(answered_after_s)
        stated = proven.of(rate_dps, asked_s)
        if not math.isnan(stated):
            assert abs(stated) <= abs(acceleration_dps2) * (1.0 + 1e-9)
            assert stated * acceleration_dps2 >= 0.0


@given(late_s=st.floats(0.0, SHORTEST_S / 4))
def test_of_a_real_acceleration_a_quick_line_leaves_most(late_s: float) -> None:
    clock = CountedClock()
    proven = ProvenAcceleration(clock, rate_error_dps=0.05)
    for number in range(3):
        asked_s = clock.now()
        clock.sleep(late_s)
        stated = proven.of(2000.0 * clock.now(), asked_s)
        clock.sleep(0.05)
        assert number == 0 or 0.8 * 2000.0 < stated <= 2000.0
