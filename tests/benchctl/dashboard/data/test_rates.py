"""The rate by the encoder: its window, its ends, the jump from 360 to 0, gaps; the same however it is read."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.dashboard.data.channels import GrowingRate, RateSamples, half_window, rates_dps
from benchctl_instruments.arrays import FloatArray


class Row:
    """A row of samples in memory."""

    def __init__(self, values: FloatArray) -> None:
        self.values, self.length = values, len(values)

    def read(self, first: int, end: int) -> FloatArray:
        return self.values[first:end]


def _turning(rate_dps: float, count: int = 500, rate_hz: float = 100.0) -> tuple[FloatArray, FloatArray]:
    time_s = 7.0 + np.arange(count) / rate_hz
    return time_s, np.mod(350.0 + rate_dps * np.arange(count) / rate_hz, 360.0)


@pytest.mark.parametrize("rate_dps", [-1000.0, -50.0, 0.0, 12.5, 3000.0])
def test_a_constant_rate_is_the_same_at_every_sample_also_where_the_angle_jumps(rate_dps: float) -> None:
    time_s, angle_deg = _turning(rate_dps)
    assert rates_dps(time_s, angle_deg, 3, 0.01) == pytest.approx(rate_dps, abs=1e-8)


@pytest.mark.parametrize(("rate_hz", "half"), [(1000.0, 25), (100.0, 3), (40.0, 1), (10.0, 1), (100_000.0, 2500)])
def test_the_window_is_as_long_as_is_said_or_longer(rate_hz: float, half: int) -> None:
    assert half_window(rate_hz) == half
    assert 2 * half / rate_hz >= 0.05


def test_the_rate_is_that_over_the_window_around_each_sample() -> None:
    time_s = np.arange(200) / 100.0
    angle_deg = 30.0 * time_s**2  # 60 deg/s²
    found = rates_dps(time_s, np.mod(angle_deg, 360.0), 3, 0.01)
    assert found[3:-3] == pytest.approx(60.0 * time_s[3:-3])
    assert set(found[:3]) == {found[3]}
    assert set(found[-3:]) == {found[-4]}


def test_across_a_gap_nobody_knows_the_rate() -> None:
    time_s, angle_deg = _turning(100.0)
    kept = np.r_[:200, 201:500]
    found = rates_dps(time_s[kept], angle_deg[kept], 3, 0.01)
    assert np.flatnonzero(np.isnan(found)).tolist() == list(range(197, 203))
    assert found[~np.isnan(found)] == pytest.approx(100.0)


def test_an_angle_that_is_no_number_spoils_its_neighbours_only() -> None:
    time_s, angle_deg = _turning(100.0)
    angle_deg[200] = np.nan
    found = rates_dps(time_s, angle_deg, 3, 0.01)
    assert np.flatnonzero(np.isnan(found)).tolist() == [197, 203]


def test_a_step_of_too_few_samples_has_no_rate() -> None:
    time_s, angle_deg = _turning(100.0, count=6)
    assert np.isnan(rates_dps(time_s, angle_deg, 3, 0.01)).all()
    assert np.isnan(RateSamples(Row(time_s), Row(angle_deg), 100.0).read(2, 4)).all()


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 300), st.integers(0, 300), st.sampled_from([None, 100.0]))
def test_any_stretch_is_bit_by_bit_that_of_the_whole(one: int, other: int, rate_hz: float | None) -> None:
    first, end = sorted((one, other))
    time_s, angle_deg = _turning(777.0, count=300)
    whole = rates_dps(time_s, angle_deg, 3, 0.01)
    found = RateSamples(Row(time_s), Row(angle_deg), rate_hz).read(first, end)
    assert found.tobytes() == whole[first:end].tobytes()


@settings(deadline=None, max_examples=60)
@given(st.lists(st.integers(0, 40), max_size=30), st.sampled_from([None, 100.0]))
def test_a_growing_step_gives_each_rate_once_and_as_it_stays(sizes: list[int], rate_hz: float | None) -> None:
    count = sum(sizes)
    time_s, angle_deg = _turning(777.0, count=count)
    growing = GrowingRate(rate_hz)
    ends = np.cumsum([0, *sizes])
    parts = [growing.add(time_s[a:b], angle_deg[a:b]) for a, b in pairwise(ends)]
    parts.append(growing.finish())
    times = np.concatenate([part[0] for part in parts])
    rates = np.concatenate([part[1] for part in parts])
    if count > 6:
        assert times.tobytes() == time_s.tobytes()
        assert rates == pytest.approx(rates_dps(time_s, angle_deg, 3, 0.01), rel=1e-12)
    else:
        assert times.size == 0
