"""Lines of angle that both sensors see, and those that only one does."""

import numpy as np
import pytest

from benchctl.diagnosis.gyro.angle_lines import lines_of_angle

INTERVAL_S = 0.01
NOISE_DPS = 0.3


def shaken(*, motion_deg=0.0, encoder_deg=0.0, gyro_dps=0.0, late_s=0.0):
    """A shaft to and fro at 40 deg/s for five minutes: what lines_of_angle is told of it."""
    chance = np.random.default_rng(3)
    dense = np.arange(0.0, 300.0, INTERVAL_S / 10)
    sweep = 90.0 + 80.0 * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * dense / 8.0))

    def true_angle(t):
        plain = np.interp(t, dense, sweep)
        return plain + motion_deg * np.sin(np.radians(100 * plain))

    time_s = np.arange(1.0, 299.0, INTERVAL_S)
    angle = true_angle(time_s)
    rate = (true_angle(time_s + 5e-4 - late_s) - true_angle(time_s - 5e-4 - late_s)) / 1e-3
    stated = angle + encoder_deg * np.sin(np.radians(100 * angle)) + 1e-3 * chance.standard_normal(time_s.size)
    felt = rate + gyro_dps * np.cos(np.radians(100 * angle)) + NOISE_DPS * chance.standard_normal(time_s.size)
    plain_rate = np.gradient(np.interp(time_s, dense, sweep), INTERVAL_S)
    rows = np.ones(time_s.size, np.bool_)
    rows[-1] = False
    return {"angle_deg": stated, "rate_dps": plain_rate, "felt": felt, "rows": rows, "interval_s": INTERVAL_S}


@pytest.mark.parametrize("late_s", [0.0, 0.012])
def test_what_the_shaft_does_both_see_however_late_the_gyro_is(late_s):
    line, *_ = lines_of_angle(**shaken(motion_deg=0.05, late_s=late_s))
    assert line.startswith("A line at 3.6° of angle (100 a turn, 11.1 Hz at 40 °/s) is true motion")


def test_an_error_of_the_encoder_is_not_felt():
    line, *_ = lines_of_angle(**shaken(encoder_deg=0.05))
    assert "A line at 3.6° of angle" in line
    assert "is an error of the encoder: the gyro does not see it" in line


def test_an_error_of_the_gyro_is_not_seen():
    line, *_ = lines_of_angle(**shaken(gyro_dps=3.0))
    assert "is an error of the gyro: the encoder does not see it" in line


def test_noise_has_no_lines():
    assert lines_of_angle(**shaken()) == ()
