"""The white noise of smooth signals, whatever they are besides."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.signals.normal import white_noise_of


@pytest.mark.parametrize("order", [2, 3, 4])
def test_white_noise_is_told_from_what_is_smooth(order: int) -> None:
    time_s = np.arange(20_000) * 1e-3
    noise = 0.3 * np.random.default_rng(0).standard_normal(time_s.size)
    assert white_noise_of(50.0 * np.sin(time_s) + noise, order=order) == pytest.approx(0.3, rel=0.03)


def test_several_signals_are_taken_together_and_a_jump_between_them_is_none() -> None:
    noise = np.random.default_rng(1).standard_normal((50, 200))
    assert white_noise_of(*(noise + 1e3 * np.arange(50)[:, None])) == pytest.approx(1.0, rel=0.03)


def test_signals_that_are_too_short_show_no_noise() -> None:
    assert white_noise_of() == white_noise_of(np.zeros(0), np.ones(3)) == 0.0
