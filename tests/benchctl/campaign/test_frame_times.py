"""From the numbers of frames and the moments at which they came to one even time line."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.campaign.frames import UNKNOWN, FrameTimes
from benchctl_instruments.arrays import IntArray
from benchctl_instruments.interfaces import GyroBlock, GyroCounts, GyroGap

RATE_HZ = 1000.0
WRAP = 128
ALL_S = 1e9


def block(sequence: IntArray, gaps: tuple[GyroGap, ...] = (), *, valid: bool = True, status: int = 0) -> GyroBlock:
    return GyroBlock(
        sequence=sequence,
        rate_dps=0.5 * sequence,
        rates_dps=np.outer(sequence, [0.5, 0.0, 0.0]),
        temperature_c=np.full(sequence.size, 20.0),
        status=np.full(sequence.size, status),
        valid=np.full(sequence.size, valid),
        faults=(),
        gaps=gaps,
        counts=GyroCounts(samples=sequence.size, lost=0, bad_frames=0, junk_bytes=0),
        wrap=WRAP,
    )


@settings(max_examples=40)
@given(
    zero_s=st.floats(0.0, 1e5),
    delays_s=st.lists(st.floats(0.0, 0.2), min_size=2, max_size=40),
    size=st.integers(1, 50),
)
def test_jitter_moves_no_sample_against_another_and_the_least_delay_alone_moves_them_all(
    zero_s: float, delays_s: list[float], size: int
) -> None:
    times = FrameTimes(RATE_HZ)
    for number, delay_s in enumerate(delays_s):
        sequence = np.arange(number * size, (number + 1) * size)
        times.feed(block(sequence), zero_s + sequence[-1] / RATE_HZ + delay_s)
    times.settle()
    frames = times.take(ALL_S)
    index = np.arange(len(delays_s) * size)
    np.testing.assert_allclose(frames.time_s, zero_s + min(delays_s) + index / RATE_HZ, rtol=0.0, atol=1e-9)
    assert not frames.missing.any()


def test_what_comes_after_the_line_is_settled_does_not_move_it() -> None:
    times = FrameTimes(RATE_HZ)
    times.feed(block(np.arange(10)), 5.019)
    times.settle()
    assert times.is_settled
    times.feed(block(np.arange(10, 20)), 5.0195)
    frames = times.take(ALL_S)
    np.testing.assert_allclose(frames.time_s, 5.010 + np.arange(20) / RATE_HZ)
    assert times.reached_s == pytest.approx(5.030)


def test_samples_are_taken_up_to_an_instant_and_none_is_taken_twice() -> None:
    times = FrameTimes(RATE_HZ)
    times.feed(block(np.arange(100)), 0.099)
    times.settle()
    assert times.take(0.0305).time_s.size == 31
    second = times.take(ALL_S)
    assert second.time_s[0] == pytest.approx(0.031)
    assert second.time_s.size == 69
    assert times.take(ALL_S).time_s.size == 0


def test_missing_samples_are_told_at_the_sample_after_them_within_a_block_and_between_two() -> None:
    times = FrameTimes(RATE_HZ)
    times.feed(block(np.array([0, 1, 4, 5]), (GyroGap(index=2, lost=2, exact=True),)), 0.005)
    times.feed(block(np.array([7, 8])), 0.008)
    times.settle()
    frames = times.take(ALL_S)
    assert frames.missing.tolist() == [0, 0, 2, 0, 1, 0]
    np.testing.assert_allclose(frames.time_s, np.array([0, 1, 4, 5, 7, 8]) / RATE_HZ)


@pytest.mark.parametrize("wraps", [0, 1, 3])
@pytest.mark.parametrize("late_s", [0.0, 0.03])
def test_after_a_deaf_time_the_stamps_say_how_many_whole_wraps_are_missing(wraps: int, late_s: float) -> None:
    times = FrameTimes(RATE_HZ)
    times.feed(block(np.arange(50)), 0.049)
    times.settle()
    after = 50 + 7 + wraps * WRAP
    gap = GyroGap(index=0, lost=7, exact=False)
    times.feed(block(np.arange(57, 90), (gap,)), (after + 32) / RATE_HZ + late_s)
    assert not times.is_settled
    assert times.take(ALL_S).time_s.size == 50
    times.settle()
    frames = times.take(ALL_S)
    assert frames.time_s[0] == pytest.approx(after / RATE_HZ)
    assert frames.missing[0] == 7 + wraps * WRAP


def test_of_several_deaf_times_in_one_leap_of_a_clock_the_freshest_samples_have_the_last_word() -> None:
    times = FrameTimes(RATE_HZ)
    gap = GyroGap(index=0, lost=1, exact=False)
    for first, last in itertools.pairwise([0, 1000, 2001, 5000]):  # each begins one after the one before it ended
        begins = first + (first > 0)
        times.feed(block(np.arange(begins, last), (gap,) if first else ()), 5.0)
    times.settle()
    frames = times.take(ALL_S)
    assert frames.missing.sum() == 2
    assert frames.time_s[-1] == pytest.approx(5.0)


def test_a_sample_for_which_the_gyro_does_not_vouch_has_a_status_that_is_never_zero() -> None:
    times = FrameTimes(RATE_HZ)
    times.feed(block(np.arange(2), status=0x77), 0.0)
    times.feed(block(np.arange(2, 4), valid=False, status=0), 0.0)
    times.feed(block(np.arange(4, 6), valid=False, status=0x73), 0.0)
    times.settle()
    assert times.take(ALL_S).status.tolist() == [0.0, 0.0, UNKNOWN, UNKNOWN, UNKNOWN + 0x73, UNKNOWN + 0x73]


def test_a_stream_that_fell_silent_before_a_leap_of_the_clock_began_no_later_than_it_was_agreed() -> None:
    times = FrameTimes(RATE_HZ)
    times.feed(block(np.arange(20)), 5.0)
    times.settle(0.3)
    assert times.take(ALL_S).time_s[0] == 0.3
