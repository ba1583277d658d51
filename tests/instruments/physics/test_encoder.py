from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.encoder import EncoderParameters, encoder_angle_deg, quadrature_count

ENCODER = EncoderParameters()
PERFECT = EncoderParameters(eccentricity_arcsec=0.0, ellipticity_arcsec=0.0)


def test_the_error_is_one_line_at_once_and_one_at_twice_a_revolution() -> None:
    turn = np.linspace(0.0, 360.0, 3600, endpoint=False)
    error_arcsec = (encoder_angle_deg(ENCODER, turn) - turn) * 3600.0
    lines = np.abs(np.fft.rfft(error_arcsec)) / 1800
    assert lines[1] == pytest.approx(15.0)
    assert lines[2] == pytest.approx(5.0)
    assert np.delete(lines, [1, 2]).max() < 1e-6
    assert np.abs(error_arcsec).max() <= 20.0


def test_the_error_is_zero_and_rising_at_its_phase() -> None:
    eccentric = replace(PERFECT, eccentricity_arcsec=15.0, eccentricity_phase_deg=40.0)
    before, at, after = encoder_angle_deg(eccentric, np.array([39.0, 40.0, 41.0])) - np.array([39.0, 40.0, 41.0])
    assert before < at < after
    assert at == pytest.approx(0.0, abs=1e-12)


def test_the_count_is_the_number_of_whole_steps_passed() -> None:
    angles = np.array([0.0, 0.0009, 0.0011, 359.9999, 720.0005, -0.0001])
    assert quadrature_count(PERFECT, angles).tolist() == [0, 0, 1, 359_999, 720_000, -1]


def test_a_reversed_encoder_counts_down() -> None:
    backwards = replace(PERFECT, sign=-1)
    assert quadrature_count(backwards, np.array([90.0, -90.0])).tolist() == [-90_000, 90_000]


@given(angle=st.floats(-1e6, 1e6))
def test_a_count_is_never_off_by_more_than_a_step(angle: float) -> None:
    count = quadrature_count(PERFECT, np.array([angle]))[0]
    assert 0.0 <= angle - count / 1000.0 < 0.001 + 1e-9


@pytest.mark.parametrize("wrong", [{"counts_per_rev": 0}, {"sign": 0}])
def test_an_impossible_encoder_is_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(UsageError):
        EncoderParameters(**wrong)
