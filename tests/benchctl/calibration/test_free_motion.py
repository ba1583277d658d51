"""Scale and delay in angle, of made and of real runs in free motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchctl.calibration.calibrate import calibrate
from benchctl.calibration.free_motion import fit_free_motion
from benchctl.recordings.importing import read_foreign
from benchctl.signals.rate import unwrap_deg
from benchctl_instruments.errors import UsageError
from tests.shared import SHARED, needs_shared

FS = 100.0
MAP = Path(__file__).parents[1] / "recordings" / "maps" / "uiuc.toml"


def wandering(seed: int, delay: float, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Angle by a coarse encoder and delayed rate of a motion of many sines, ten minutes."""
    rng = np.random.default_rng(seed)
    t = np.arange(60_000) / FS
    angle, rate = np.zeros(t.size), np.zeros(t.size)
    for f, amplitude, phase in zip(rng.uniform(0.03, 1.0, 8), rng.uniform(5, 40, 8), rng.uniform(0, 6, 8), strict=True):
        angle += amplitude * np.sin(2 * np.pi * f * t + phase)
        rate += 2 * np.pi * f * amplitude * np.cos(2 * np.pi * f * (t - delay) + phase)
    return np.floor(angle / 0.0879) * 0.0879, 0.4 + scale * rate + 0.05 * rng.standard_normal(t.size)


def test_scale_and_delay_are_found_together_within_their_intervals() -> None:
    inside = []
    for seed in range(20):
        fit = fit_free_motion(*wandering(seed, delay=0.0123, scale=1.006), FS)
        inside.append(fit.scale_ci95[0] < 1.006 < fit.scale_ci95[1])
        inside.append(fit.delay_ci95[0] < 0.0123 < fit.delay_ci95[1])
        assert fit.scale == pytest.approx(1.006, abs=3e-4)
        assert fit.delay_s == pytest.approx(0.0123, abs=1e-4)
        assert fit.after_deg < 0.1 * fit.before_deg
    assert np.mean(inside) > 0.8


@pytest.mark.parametrize(("size", "motion", "says"), [(3000, 30.0, "at least 300 s"), (60_000, 0.01, "rms only")])
def test_a_run_that_cannot_tell_is_refused(size: int, motion: float, says: str) -> None:
    t = np.arange(size) / FS
    with pytest.raises(UsageError, match=says):
        fit_free_motion(motion * np.sin(t), motion * np.cos(t), FS)


@needs_shared("data/uiuc_encoder_imu")
def test_a_real_gyro_has_its_scale_and_is_about_a_sample_late() -> None:
    meta, steps = read_foreign(SHARED / "data/uiuc_encoder_imu/raw_yaw_slow.mat", MAP)
    angle, gyro = unwrap_deg(steps[0]["encoder_deg"]), steps[0]["gyro_v"]
    fs = 1.0 / float(np.median(np.diff(steps[0]["time_s"])))
    fit = fit_free_motion(angle, gyro, fs)
    assert fit.scale == pytest.approx(1.0060, abs=2e-4)
    assert fit.delay_s == pytest.approx(0.0120, abs=3e-4)
    assert fit.scale_ci95[1] - fit.scale_ci95[0] < 2e-4
    assert 0.5 < fit.before_deg < 0.7
    assert fit.after_deg == pytest.approx(0.14, abs=0.02)
    # The trap: by sums of samples instead of trapezoids half a sample of the delay is lost.
    by_sums = np.cumsum(gyro - gyro.mean()) / fs
    by_trapezoids = np.r_[0.0, np.cumsum((gyro - gyro.mean())[1:] + (gyro - gyro.mean())[:-1])] / (2 * fs)
    rate = gyro - gyro.mean()
    lost = float((by_sums - by_trapezoids) @ rate / (rate @ rate))
    assert lost == pytest.approx(0.5 / fs, rel=0.01)
    result = calibrate(steps, meta)
    assert result.free_motion is not None
    assert result.free_motion.scale == fit.scale
    assert result.best.value("K0_v_per_dps") == pytest.approx(fit.scale, abs=3e-3)
    assert any("free motion alone" in warning for warning in result.warnings)
