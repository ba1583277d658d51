from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.physics.effects.clock_drift import ClockDrift
from benchctl_instruments.physics.effects.timing_offset import TimingOffset
from benchctl_instruments.simulated.world import TwoClocks

INTERVAL = 0.008


def stamps(start_s: float, scans: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return start_s + INTERVAL * np.arange(scans, dtype=np.float64)


@given(
    offset_s=st.floats(-0.05, 0.05),
    ppm=st.floats(-200.0, 200.0),
    start_s=st.floats(0.0, 20_000.0),
    cuts=st.lists(st.integers(1, 499), max_size=4, unique=True),
)
@settings(max_examples=60, deadline=None)
def test_the_gyro_is_shifted_by_what_its_clock_says_and_nothing_is_read_in_the_future(
    offset_s: float, ppm: float, start_s: float, cuts: list[int]
) -> None:
    effects = [TimingOffset(offset_s=offset_s), ClockDrift(ppm=ppm)]
    times = stamps(start_s, 500)
    encoder_s, gyro_s = TwoClocks(effects).instants(times, INTERVAL)
    np.testing.assert_allclose(gyro_s - encoder_s, 1e-6 * ppm * times - offset_s, atol=1e-9)
    assert max((encoder_s - times).max(), (gyro_s - times).max()) <= 1e-9
    np.testing.assert_allclose(np.diff(encoder_s), INTERVAL, rtol=1e-6)  # its rate is the table's
    oldest_s = times[0] - min(encoder_s[0], gyro_s[0])
    assert oldest_s <= TwoClocks(effects).reach_s(start_s) + 1e-9
    again = TwoClocks(effects)
    pieces = [again.instants(times[a:b], INTERVAL) for a, b in itertools.pairwise([0, *sorted(cuts), 500])]
    np.testing.assert_array_equal(np.concatenate([piece[1] for piece in pieces]), gyro_s)


def test_older_samples_leave_the_encoder_where_it_is() -> None:
    encoder_s, gyro_s = TwoClocks([TimingOffset(offset_s=0.05)]).instants(stamps(100.0, 3), INTERVAL)
    np.testing.assert_array_equal(encoder_s, stamps(100.0, 3))
    np.testing.assert_allclose(gyro_s, stamps(99.95, 3))


def test_every_stream_begins_with_a_lead_of_its_own() -> None:
    clocks = TwoClocks([ClockDrift(ppm=100.0)])
    leads = []
    for start_s in (0.0, 10_000.0):
        times = stamps(start_s, 10)
        leads.append(times[0] - clocks.instants(times, INTERVAL)[0][0])
    # what the clock has run away by an hour later
    assert leads == pytest.approx([0.36, 1.36])


def test_a_stream_that_outlasts_its_room_follows_the_drift() -> None:
    clocks = TwoClocks([ClockDrift(ppm=200.0)])
    times = np.arange(0.0, 9000.0, 10.0)
    encoder_s, gyro_s = clocks.instants(times, 10.0)
    assert gyro_s[-1] == pytest.approx(times[-1])
    assert np.diff(encoder_s)[:359] == pytest.approx(10.0)
    assert np.diff(encoder_s)[-1] == pytest.approx(10.0 - 2e-3)
