"""What an encoder's noise adds to a rate, against noise that is drawn and filtered."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from benchctl.diagnosis.gyro.encoder_noise import rate_variance, steadied_rate
from benchctl.signals.motion import Motion, motion_of, rates_of

FloatArray = npt.NDArray[np.float64]
RATE_HZ, ROWS, NOISE_DEG = 100.0, 20000, 0.5 / 3600.0
TIME_S = np.arange(ROWS) / RATE_HZ
INSIDE = slice(500, ROWS - 500)
SHAKEN = slice(10000, 12000)
TOLERANCE = 0.2
"""The median of fourth differences sees a tenth of the rows shaken as a little more noise."""


def noise(seed: int = 0) -> FloatArray:
    return NOISE_DEG * np.random.default_rng(seed).standard_normal(ROWS)


def frame(*stretches: tuple[FloatArray, Motion]) -> Any:
    bounds = np.cumsum([0, *(angle.size for angle, _ in stretches)]).tolist()
    return SimpleNamespace(
        rows=bounds[-1],
        interval_s=1.0 / RATE_HZ,
        rate_dps=np.concatenate([motion.rate_dps for _, motion in stretches]),
        stretches=[slice(a, b) for a, b in itertools.pairwise(bounds)],
        motions=[motion for _, motion in stretches],
        encoder_deg=np.concatenate([angle for angle, _ in stretches]),
    )


def moved(path: Callable[[FloatArray], FloatArray], seed: int = 0) -> tuple[FloatArray, Motion]:
    angle = path(TIME_S) + noise(seed)
    return angle, motion_of(angle, RATE_HZ)


def steady(time_s: FloatArray) -> FloatArray:
    return 30.0 + 40.0 * time_s


def shaken(time_s: FloatArray) -> FloatArray:
    """For a tenth of the time faster than the narrow filter passes."""
    return np.asarray(np.where((time_s > 98.0) & (time_s < 122.0), 2e-3 * np.sin(2 * np.pi * 16.0 * time_s), 0.0))


@pytest.mark.parametrize(("path", "where"), [(steady, INSIDE), (shaken, SHAKEN)])
def test_the_variance_is_that_of_the_noise_behind_the_motion_s_own_filters(
    path: Callable[[FloatArray], FloatArray], where: slice
) -> None:
    angle, motion = moved(path)
    whole, step = rate_variance(frame((angle, motion)))
    drawn = np.stack([rates_of([motion], [noise(seed)])[0] for seed in range(1, 6)])[:, where]
    assert float(np.mean(drawn**2)) == pytest.approx(float(whole[where].mean()), rel=TOLERANCE)
    assert 0.5 * float(np.mean(np.diff(drawn) ** 2)) == pytest.approx(float(step[where].mean()), rel=TOLERANCE)


def test_where_the_filters_are_mixed_it_is_that_of_their_mixture() -> None:
    angle, motion = moved(steady)
    half = replace(motion, sudden=np.full(ROWS, 0.5))
    whole, step = rate_variance(frame((angle, half)))
    drawn = np.stack([rates_of([half], [noise(seed)])[0] for seed in range(1, 6)])[:, INSIDE]
    assert float(np.mean(drawn**2)) == pytest.approx(float(whole[INSIDE].mean()), rel=0.05)
    assert 0.5 * float(np.mean(np.diff(drawn) ** 2)) == pytest.approx(float(step[INSIDE].mean()), rel=0.05)


def test_it_is_larger_where_the_motion_is_sudden() -> None:
    calm, hasty = moved(steady), moved(shaken)
    whole, _ = rate_variance(frame(calm, hasty))
    assert float(hasty[1].sudden[SHAKEN].min()) > 0.9
    assert float(whole[ROWS:][SHAKEN].mean()) > 3.0 * float(whole[:ROWS][SHAKEN].mean())
    assert float(whole[ROWS:][500:9000].mean()) < 1.5 * float(whole[:ROWS][500:9000].mean())


def test_it_grows_with_the_square_of_the_noise() -> None:
    angle, motion = moved(steady)
    loud = steady(TIME_S) + 3.0 * (angle - steady(TIME_S))
    whole, step = rate_variance(frame((angle, motion)))
    louder_whole, louder_step = rate_variance(frame((loud, motion)))
    np.testing.assert_allclose(louder_whole, 9.0 * whole, rtol=1e-6)
    np.testing.assert_allclose(louder_step, 9.0 * step, rtol=1e-6)


def test_all_stretches_have_one_noise_which_a_rare_fast_sine_does_not_change() -> None:
    sine = moved(lambda time_s: 0.1 * np.sin(2 * np.pi * 20.0 * time_s))
    alone, _ = rate_variance(frame(sine))
    calm = [moved(steady, seed) for seed in range(1, 20)]
    plain, _ = rate_variance(frame(*calm))
    whole, _ = rate_variance(frame(*calm, sine))
    assert float(whole[: plain.size].mean()) == pytest.approx(float(plain.mean()), rel=TOLERANCE)
    assert float(whole[plain.size :].mean()) < 1e-3 * float(alone.mean())


def test_a_stretch_too_short_to_see_noise_in_has_none() -> None:
    _, motion = moved(steady)
    short = Motion(
        angle_deg=motion.angle_deg[:8],
        rate_dps=motion.rate_dps[:8],
        acceleration_dps2=motion.acceleration_dps2[:8],
        sudden=motion.sudden[:8],
        filters=motion.filters,
        ripple=motion.ripple,
    )
    whole, step = rate_variance(frame((steady(TIME_S[:8]) + noise()[:8], short)))
    assert np.array_equal(whole, np.zeros(8))
    assert np.array_equal(step, np.zeros(8))


def test_rows_are_sorted_by_a_rate_without_the_noise_of_the_row_where_the_table_turns_steadily() -> None:
    angle, motion = moved(steady)
    noise_of_row = motion.rate_dps[INSIDE] - 40.0
    sorted_by = steadied_rate(frame((angle, motion)))[INSIDE] - 40.0
    assert float(np.std(sorted_by)) < 0.1 * float(np.std(noise_of_row))


def test_rows_are_sorted_by_their_own_rate_where_the_table_swings() -> None:
    _, motion = swing = moved(lambda time_s: 10.0 * np.sin(2.0 * np.pi * 0.5 * time_s))
    np.testing.assert_array_equal(steadied_rate(frame(swing)), motion.rate_dps)
