import numpy as np
import pytest

from benchctl.signals.binning import line_scores


def test_scores_over_the_turn_are_the_sums_over_the_rows() -> None:
    chance = np.random.default_rng(1)
    values, angle = chance.standard_normal(3000), chance.uniform(-2000.0, 2000.0, 3000)
    scores = line_scores(values, angle, 900)
    for order in (0, 1, 36, 250):
        direct = np.sum(values * np.exp(1j * np.radians(order * angle)))
        assert scores[order] == pytest.approx(direct, abs=3e-2 * np.sqrt(3000))


def test_a_planted_wave_has_its_own_order_and_phase() -> None:
    angle = np.random.default_rng(2).uniform(0.0, 360.0, 20_000)
    scores = line_scores(np.cos(np.radians(5000.0 * angle - 40.0)), angle, 20_000)
    assert int(np.argmax(np.abs(scores))) == 5000
    assert np.degrees(np.angle(scores[5000])) == pytest.approx(40.0, abs=2.0)
