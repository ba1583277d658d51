"""A trail: the last stretch of a channel, of which every view has the lowest and highest of all samples."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.dashboard.data import trails as module
from benchctl.dashboard.data.trails import Trail
from benchctl_instruments.arrays import FloatArray
from tests.benchctl.dashboard.data import brute


def _channel(steps: list[float]) -> tuple[FloatArray, FloatArray]:
    time_s = np.cumsum(np.array(steps))
    return time_s, np.random.default_rng(len(steps)).normal(size=len(steps))


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.sampled_from([0.1, 0.1, 0.1, 0.1, 3.0]), min_size=1, max_size=600),
    st.integers(1, 200),
    st.floats(0.5, 200.0),
)
def test_a_view_has_the_lowest_and_highest_of_all_samples(steps: list[float], stride: int, window_s: float) -> None:
    time_s, values = _channel(steps)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "ROWS", 64)  # so that few samples already go into blocks of every size
        trail = Trail()
        for begin in range(0, len(time_s), stride):
            trail.add(time_s[begin : begin + stride], values[begin : begin + stride])
        found = trail.view(time_s[-1] - window_s, time_s[-1], 5)
    brute.assert_is_of(found, time_s, values, time_s[-1])
    assert found["t_s"] == sorted(found["t_s"])


def test_few_samples_are_given_one_by_one_as_they_are() -> None:
    trail = Trail()
    trail.add(np.array([1.0, 2.0]), np.array([5.0, np.nan]))
    trail.add(np.array([3.0]), np.array([7.0]))
    told = [5.0, None, 7.0]
    assert trail.view(0.0, 3.0, 10) == {"t_s": [1.0, 2.0, 3.0], "low": told, "high": told}
    assert trail.view(2.5, 3.0, 10)["t_s"] == [3.0]
    assert trail.view(4.0, 5.0, 10) == {"t_s": [], "low": [], "high": []}


def test_samples_that_are_not_later_are_left_out() -> None:
    trail = Trail()
    trail.add(np.array([1.0, 2.0]), np.array([1.0, 2.0]))
    trail.add(np.array([0.5, 2.0, 3.0]), np.array([9.0, 9.0, 3.0]))
    assert trail.view(0.0, 9.0, 10)["low"] == [1.0, 2.0, 3.0]


def test_a_long_fast_channel_takes_little_memory_and_is_all_there() -> None:
    trail, count = Trail(), 3_000_000
    for begin in range(0, count, 50_000):
        time_s = np.arange(begin, begin + 50_000) * 1e-4
        trail.add(time_s, np.sin(time_s))
    found = trail.view(0.0, count * 1e-4, 400)
    assert len(found["t_s"]) == 400
    assert None not in found["low"]
    assert max(found["high"]) == pytest.approx(1.0, abs=1e-8)
    assert trail.nbytes < 40 << 20


def test_nothing_is_nothing() -> None:
    assert Trail().view(0.0, 1.0, 3) == {"t_s": [], "low": [], "high": []}
    Trail().end_block()
