"""Dirty stamps: what is found in them, what is done, and when the answer is no."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.recordings.stamps import (
    Gap,
    StampError,
    printed_resolution,
    repair,
    require_increase,
    require_uniform,
)
from benchctl_instruments.arrays import FloatArray

PERIOD = 0.01001


def printed_down(count: int, decimals: int = 3) -> FloatArray:
    """Stamps of a clock of 10.01 ms, printed by cutting digits off, as many loggers do."""
    return np.asarray(np.floor((7.0 + np.arange(count) * PERIOD) * 10**decimals) / 10**decimals, dtype=np.float64)


def never(count: int) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    return np.zeros(count, dtype=np.bool_)


def test_rounding_is_seen_for_what_it_is() -> None:
    survey = repair(printed_down(5000), never(5000), fill=False).survey
    assert survey is not None
    assert survey.resolution_s == 1e-3
    assert survey.rounding_rms_s == pytest.approx(1e-3 / 12**0.5)
    assert survey.scatter_rms_s == pytest.approx(survey.rounding_rms_s, rel=0.05)
    assert survey.period_s == pytest.approx(PERIOD, rel=1e-6)
    assert survey.drift_s < 1e-4


def test_rounded_stamps_become_uniform_ones() -> None:
    base = repair(printed_down(5000), never(5000), fill=False)
    assert base.starts == (0,)
    assert np.ptp(np.diff(base.time_s)) < 1e-9
    assert np.max(np.abs(base.time_s - np.arange(5000) * PERIOD)) < 1e-4
    assert base.rows.tolist() == list(range(5000))


def test_a_row_written_twice_in_the_place_of_a_lost_one_is_a_gap_of_one() -> None:
    stamps = printed_down(1000)
    values = np.arange(1000.0)
    stamps[501], values[501] = stamps[500], values[500]
    base = repair(stamps, np.r_[False, np.diff(values) == 0], fill=False)
    assert base.survey is not None
    assert base.survey.repeated_rows == (501,)
    assert base.survey.gaps == (Gap(after_row=500, missing=1, stamp_s=float(stamps[500])),)
    assert base.starts == (0, 501)
    assert base.time_s[501] == pytest.approx(502 * base.survey.period_s)
    assert base.place(values)[500:502].tolist() == [500, 502]


def test_a_filled_gap_lies_on_the_line_and_is_marked() -> None:
    stamps = np.delete(printed_down(1000), [300, 600, 601])
    values = np.delete(np.arange(1000.0), [300, 600, 601])
    base = repair(stamps, never(997), fill=True)
    assert base.starts == (0,)
    assert np.flatnonzero(base.filled).tolist() == [300, 600, 601]
    assert base.place(values) == pytest.approx(np.arange(1000.0))


def test_a_long_gap_is_never_filled() -> None:
    stamps = np.delete(printed_down(1000), slice(400, 460))
    base = repair(stamps, never(940), fill=True)
    assert base.starts == (0, 400)
    assert not base.filled.any()
    assert base.time_s[400] == pytest.approx(460 * PERIOD, rel=1e-5)


def test_a_clock_that_wanders_slowly_is_told_and_does_not_lose_a_sample() -> None:
    k = np.arange(40_000)
    stamps = np.round(k * PERIOD + 0.02 * np.sin(2 * np.pi * k / 40_000), 3)
    base = repair(stamps, never(k.size), fill=False)
    assert base.survey is not None
    assert base.survey.gaps == ()
    assert base.survey.drift_s > 0.015
    assert base.survey.scatter_rms_s == pytest.approx(base.survey.rounding_rms_s, rel=0.1)


@pytest.mark.parametrize(
    ("spoil", "row", "says"),
    [
        (lambda t: t.__setitem__(50, t[49] - 0.02), 50, "goes back"),
        (lambda t: t.__setitem__(50, t[49]), 50, "two rows with one stamp and different values"),
    ],
)
def test_a_stamp_that_leaves_a_doubt_is_refused(spoil: object, row: int, says: str) -> None:
    stamps = printed_down(200)
    assert callable(spoil)
    spoil(stamps)
    with pytest.raises(StampError, match=says) as caught:
        repair(stamps, never(200), fill=True)
    assert caught.value.row == row


@pytest.mark.parametrize("fill", [False, True])
def test_a_logger_that_pauses_between_two_places_of_its_clock_begins_a_new_stretch(fill: bool) -> None:
    stamps = printed_down(6000)
    for row in range(465, 6000, 465):  # the pauses that a public recording has 200 times
        stamps[row:] += 1.5 * PERIOD
    base = repair(np.floor(stamps * 1e3 + 1e-6) / 1e3, never(6000), fill=fill)
    assert base.starts == (0, *range(465, 6000, 465))
    assert base.survey is not None
    assert base.survey.restarts == len(base.starts) - 1
    assert base.survey.period_s == pytest.approx(PERIOD, rel=1e-5)
    assert np.max(np.abs(base.time_s - (stamps - stamps[0]))) < 1.1e-3  # the printing
    assert not base.filled.any()


def test_scatter_of_half_a_period_is_refused() -> None:
    rng = np.random.default_rng(4)
    stamps = np.arange(500) * 0.01 + rng.uniform(0, 0.008, 500)
    with pytest.raises(StampError, match=r"no certain place|goes back"):
        repair(stamps, never(500), fill=False)


def test_two_stamps_define_no_clock() -> None:
    with pytest.raises(StampError, match="fewer than three"):
        repair(np.array([0.0, 0.0, 1.0]), np.array([False, True, False]), fill=False)


@settings(max_examples=80, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.floats(0.004, 0.3),
    st.lists(st.integers(5, 390), max_size=6, unique=True),
    st.sampled_from([np.floor, np.rint, np.ceil]),
)
def test_the_place_of_every_sample_is_found(seed: int, period: float, lost: list[int], rounding: object) -> None:
    assert callable(rounding)
    k = np.delete(np.arange(400), lost)
    stamps = rounding((np.random.default_rng(seed).uniform(0, 1000) + k * period) * 1e3) / 1e3
    base = repair(np.asarray(stamps), never(k.size), fill=False)
    assert np.rint(base.time_s / period).tolist() == (k - k[0]).tolist()


@pytest.mark.parametrize(
    ("stamps", "resolution"),
    [([0.0, 1.0], 1.0), ([0.25, 1.0], 0.01), ([1366403088.076, 1366403089.12], 1e-3), ([1 / 3, 2.0], 0.0)],
)
def test_the_digits_of_stamps_are_recognised(stamps: list[float], resolution: float) -> None:
    assert printed_resolution(np.array(stamps)) == pytest.approx(resolution)


def test_uniform_stamps_pass_and_the_first_fault_is_named() -> None:
    stamps = np.arange(100) / 8
    require_uniform(stamps, 8.0, 1e-6)
    with pytest.raises(StampError, match=r"a gap: 0\.375 s after the row before.*\(2 samples missing\)") as caught:
        require_uniform(np.delete(stamps, [40, 41]), 8.0, 1e-6)
    assert caught.value.row == 40
    with pytest.raises(StampError, match=r"not uniform at 8\.1 Hz") as caught:
        require_uniform(stamps, 8.1, 1e-6)
    assert caught.value.row == 1


def test_stamps_must_increase() -> None:
    require_increase(np.array([3.0]))
    with pytest.raises(StampError, match="repeats that of the row before") as caught:
        require_increase(np.array([0.0, 1.0, 1.0]))
    assert caught.value.row == 2
