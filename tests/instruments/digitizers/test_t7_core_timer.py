from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl_instruments.digitizers.labjack_t7 import TICKS_HZ, WRAP, CoreTimer


@given(
    st.integers(0, WRAP - 1),
    st.lists(st.floats(0.0, 200_000.0), min_size=1, max_size=20),
    st.floats(-1e-4, 1e-4),
)
def test_seconds_are_the_counters_own_however_often_it_wrapped(start: int, steps: list[float], drift: float) -> None:
    timer = CoreTimer(start, 0.0)
    now_s = 0.0
    for step in steps:
        now_s += step
        ticks = int(now_s * TICKS_HZ)
        assert timer.look((start + ticks) % WRAP, now_s * (1.0 + drift)) == pytest.approx(ticks / TICKS_HZ, abs=1e-6)


def test_a_stamp_after_the_last_look_is_placed_after_it_across_a_wrap() -> None:
    timer = CoreTimer(WRAP - 40, 0.0)
    timer.look(WRAP - 20, 0.0)
    assert timer.seconds_at(20) == pytest.approx(60 / TICKS_HZ)


def test_a_clock_that_reads_a_little_early_does_not_turn_time_back() -> None:
    timer = CoreTimer(100, 5.0)
    assert timer.look(140, 4.9) == pytest.approx(1e-6)
