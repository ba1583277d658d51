"""What a converter's steps make of a voltage, beside a converter that was given noise."""

import numpy as np
import pytest

from benchctl.diagnosis.gyro.rounding import Rounding, rounding_between

STEP_V = 0.02


def converted(volts: np.ndarray, noise_v: float, seed: int) -> np.ndarray:
    noisy = volts + noise_v * np.random.default_rng(seed).standard_normal(volts.size)
    return STEP_V * np.rint(noisy / STEP_V)


@pytest.mark.parametrize("share", [0.02, 0.07, 0.2, 0.5])
def test_the_mean_is_that_of_many_conversions(share: float) -> None:
    volts = np.linspace(-0.05, 0.05, 41)
    noise_v = share * STEP_V
    many = np.repeat(volts, 4000)
    mean = converted(many, noise_v, seed=1).reshape(volts.size, -1).mean(axis=1)
    assert np.abs(mean - Rounding(step_v=STEP_V, noise_v=noise_v).mean_v(volts)).max() < 0.04 * STEP_V


def test_without_noise_it_is_the_coarse_converter_itself() -> None:
    volts = np.linspace(-0.0493, 0.0493, 1000)  # not on an edge between two codes
    assert STEP_V * np.rint(volts / STEP_V) == pytest.approx(
        Rounding(step_v=STEP_V, noise_v=1e-9).mean_v(volts), abs=1e-12
    )


def test_noise_of_half_a_step_leaves_nothing_of_the_steps() -> None:
    volts = np.linspace(-0.05, 0.05, 1000)
    assert np.abs(Rounding(step_v=STEP_V, noise_v=0.5 * STEP_V).mean_v(volts) - volts).max() < 0.005 * STEP_V


@pytest.mark.parametrize("share", [0.05, 0.1, 0.3])
def test_the_noise_ahead_of_the_steps_is_found(share: float) -> None:
    volts = np.linspace(-1.0, 1.0, 20_000)
    found = rounding_between(volts, converted(volts, share * STEP_V, seed=2), STEP_V)
    assert found.noise_v == pytest.approx(share * STEP_V, rel=0.15)


def test_a_prediction_that_is_wrong_by_many_steps_shows_none() -> None:
    volts = np.linspace(-1.0, 1.0, 20_000)
    found = rounding_between(volts + 0.3 * np.sin(volts), converted(volts, 0.05 * STEP_V, seed=3), STEP_V)
    assert found.noise_v > 0.3 * STEP_V
