from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl.bench import Bench, load_bench
from benchctl.campaign.encoder_motion import ERROR_SHARE, EncoderMotion
from benchctl_instruments.arrays import FloatArray, IntArray

BENCH = load_bench("simulated")
HZ = 500.0
COUNTS_PER_DEG = 1000.0


def counts_of(angle_deg: FloatArray, counts_per_deg: float = COUNTS_PER_DEG) -> IntArray:
    return np.rint(angle_deg * counts_per_deg).astype(np.int64)


def times_s(seconds: float, rate_hz: float = HZ) -> FloatArray:
    return np.arange(round(seconds * rate_hz)) / rate_hz


def coarse(counts_per_rev: int, limit_dps2: float, accuracy_arcsec: float = 0.0) -> Bench:
    entry = BENCH.digitizer.model_copy(
        update={"encoder_counts_per_rev": counts_per_rev, "encoder_accuracy_arcsec": accuracy_arcsec}
    )
    limits = BENCH.limits.model_copy(update={"acceleration_dps2": limit_dps2})
    return BENCH.model_copy(update={"digitizer": entry, "limits": limits})


@given(rate_dps=st.floats(-400.0, 400.0), start_deg=st.floats(0.0, 360.0))
def test_a_rate_that_is_kept_shows_no_more_than_rounding_makes(rate_dps: float, start_deg: float) -> None:
    motion = EncoderMotion(BENCH, HZ)
    seen = motion.accelerations_dps2(0, counts_of(start_deg + rate_dps * times_s(1.0)))
    assert np.abs(seen).max() <= 0.8 + 1e-9  # 2 counts of 0.001 deg in (0.05 s)²


@given(
    counts_per_rev=st.sampled_from([360, 3600, 36_000, 360_000]),
    limit_dps2=st.floats(10.0, 5000.0),
    rate_dps=st.floats(-300.0, 300.0),
    accuracy_arcsec=st.sampled_from([0.0, 20.0, 300.0]),
)
def test_however_coarse_the_encoder_its_errors_stay_below_half_of_what_is_granted(
    counts_per_rev: int, limit_dps2: float, rate_dps: float, accuracy_arcsec: float
) -> None:
    motion = EncoderMotion(coarse(counts_per_rev, limit_dps2, accuracy_arcsec), HZ)
    time_s = times_s(12.0)
    off_deg = accuracy_arcsec / 3600.0 * np.sign(np.sin(17.0 * time_s))
    counts_per_deg = counts_per_rev / 360.0
    seen = motion.accelerations_dps2(0, counts_of(rate_dps * time_s, counts_per_deg))
    assert np.abs(seen).max(initial=0.0) <= ERROR_SHARE * limit_dps2 * 1.001
    off = EncoderMotion(coarse(counts_per_rev, limit_dps2, accuracy_arcsec), HZ)
    fine = (rate_dps * time_s + off_deg) * counts_per_deg
    wrong = off.accelerations_dps2(0, fine.astype(np.int64))
    assert np.abs(wrong).max(initial=0.0) <= 2.0 * ERROR_SHARE * limit_dps2 * 1.001


@given(amplitude_dps=st.floats(1.0, 300.0), frequency_hz=st.floats(0.05, 10.0))
def test_a_swing_never_shows_more_than_its_peak_acceleration(amplitude_dps: float, frequency_hz: float) -> None:
    omega = 2.0 * np.pi * frequency_hz
    seen = EncoderMotion(BENCH, HZ).accelerations_dps2(
        0, counts_of(-amplitude_dps / omega * np.cos(omega * times_s(2.0)))
    )
    assert np.abs(seen).max() <= amplitude_dps * omega + 0.8 + 1e-9


@pytest.mark.parametrize("acceleration_dps2", [1600.0, -3000.0])
def test_an_acceleration_that_lasts_is_shown_as_it_is(acceleration_dps2: float) -> None:
    time_s = times_s(0.5)
    ramp_s = np.clip(time_s - 0.2, 0.0, 0.15)
    angle_deg = 50.0 * time_s + acceleration_dps2 * ramp_s * (time_s - 0.2 - 0.5 * ramp_s)
    seen = EncoderMotion(BENCH, HZ).accelerations_dps2(0, counts_of(angle_deg))
    assert seen[np.abs(seen).argmax()] == pytest.approx(acceleration_dps2, abs=1.0)


def test_the_sign_is_that_of_the_bench() -> None:
    entry = BENCH.digitizer.model_copy(update={"encoder_sign": -1})
    count = counts_of(-0.5 * 400.0 * times_s(0.5) ** 2)
    motion = EncoderMotion(BENCH.model_copy(update={"digitizer": entry}), HZ)
    assert motion.accelerations_dps2(0, count).mean() == pytest.approx(400.0, abs=1.0)
    assert motion.rates_dps(0, count).max() == pytest.approx(400.0 * 0.425, abs=10.0)


@given(cuts=st.lists(st.integers(1, 999), max_size=20))
def test_however_the_blocks_are_cut_the_accelerations_are_the_same(cuts: list[int]) -> None:
    count = counts_of(100.0 * np.sin(3.0 * times_s(2.0)))
    whole = EncoderMotion(BENCH, HZ).accelerations_dps2(0, count)
    motion, bounds = EncoderMotion(BENCH, HZ), sorted({0, *cuts, len(count)})
    parts = [motion.accelerations_dps2(low, count[low:high]) for low, high in itertools.pairwise(bounds)]
    assert np.concatenate(parts) == pytest.approx(whole)


def test_nothing_is_taken_across_a_gap() -> None:
    motion = EncoderMotion(BENCH, HZ)
    count = counts_of(300.0 * times_s(0.4))
    motion.accelerations_dps2(0, count)
    behind = motion.accelerations_dps2(len(count) + 1, count)  # where the table stood is not where it turned to
    assert len(behind) == len(count) - 50
    assert np.abs(behind).max() <= 0.8 + 1e-9


def test_a_single_scan_is_no_motion() -> None:
    motion = EncoderMotion(BENCH, HZ)
    assert motion.rates_dps(0, np.array([5])).size == 0
    assert motion.accelerations_dps2(0, np.array([5])).size == 0
