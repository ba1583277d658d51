import numpy as np
import pytest

from benchctl.diagnosis.signals.band_limited import half_of
from benchctl.diagnosis.signals.motion import motion_of, motions_of, rates_of
from tests.benchctl.diagnosis.turning import NOISE_DEG, RATE_HZ, turning


def test_noise_alone_is_not_taken_for_sudden_motion() -> None:
    angles, _ = turning(rates_dps=(20.0,), lasts_s=400.0)
    assert motion_of(angles[0], RATE_HZ).sudden.mean() < 2e-3


def test_sudden_motion_is_followed_from_before_it_begins() -> None:
    time_s = np.arange(0.0, 200.0, 1.0 / RATE_HZ)
    since = np.clip(time_s - 100.0, 0.0, None)
    servo = 2.0 * np.pi * 8.0
    rate = 80.0 * (1.0 - (1.0 + servo * since) * np.exp(-servo * since))
    angle = 80.0 * (since + (2.0 / servo + since) * np.exp(-servo * since) - 2.0 / servo)
    noise = NOISE_DEG * np.random.default_rng(4).standard_normal(time_s.size)
    motion = motion_of(angle + noise, RATE_HZ)
    near = (time_s > 99.8) & (time_s < 100.4)
    assert motion.sudden[near].min() == pytest.approx(1.0, rel=1e-12)
    assert np.sqrt(np.mean((motion.rate_dps - rate)[near] ** 2)) < 0.15


@pytest.mark.parametrize("sample_rate_hz", [RATE_HZ, 500.0, 2000.0])
@pytest.mark.parametrize("frequency_hz", [0.5, 4.0, 9.0])
def test_motion_in_the_band_is_followed_to_one_part_in_ten_thousand(frequency_hz: float, sample_rate_hz: float) -> None:
    time_s = np.arange(0.0, 20.0, 1.0 / sample_rate_hz)
    omega = 2.0 * np.pi * frequency_hz
    motion = motion_of(30.0 / omega * np.sin(omega * time_s), sample_rate_hz)
    inner = slice(half_of(sample_rate_hz), -half_of(sample_rate_hz))
    np.testing.assert_allclose(motion.rate_dps[inner], 30.0 * np.cos(omega * time_s[inner]), atol=3e-3)


def test_each_of_several_stretches_moves_as_by_itself() -> None:
    angles, _ = turning(rates_dps=(20.0, -145.0), lasts_s=20.0)
    stretches = [angles[0], angles[1][:900], np.full(600, 12.0)]
    motions = motions_of(stretches, RATE_HZ)
    others = [0.01 * np.sin(np.radians(36.0 * angle)) for angle in stretches]
    for angle, other, motion, rate in zip(stretches, others, motions, rates_of(motions, others), strict=True):
        alone = motion_of(angle, RATE_HZ)
        for name in ("angle_deg", "rate_dps", "acceleration_dps2", "sudden"):
            np.testing.assert_allclose(getattr(motion, name), getattr(alone, name), rtol=1e-8, atol=1e-6, err_msg=name)
        np.testing.assert_allclose(rate, rates_of([alone], [other])[0], atol=1e-9)


def test_where_the_encoder_stands_quite_still_nothing_is_sudden_whatever_the_next_stretch_does() -> None:
    """What the arithmetic leaves there is no motion."""
    angles, _ = turning(rates_dps=(145.0, -145.0), lasts_s=200.0)
    still = np.full(4000, 311.37)
    _, motion, _ = motions_of([angles[0], still, angles[1]], RATE_HZ)
    assert motion.sudden.max() == 0.0
    assert np.abs(motion.rate_dps).max() < 1e-7
