from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from benchctl.diagnosis.residual.events import _Blurred, bump, jump, lines
from benchctl.diagnosis.residual.groups import Group
from benchctl.diagnosis.residual.score_test import Score, ScoreTest
from benchctl_instruments.arrays import FloatArray

DT = 0.01
TIME_S = np.concatenate([np.arange(0.0, 300.0, DT), np.arange(380.0, 700.0, DT)])
STEP = (TIME_S // 20.0).astype(np.int64)


def left_of(structure: FloatArray, seed: int = 0) -> ScoreTest:
    noise = np.random.default_rng(seed).standard_normal(TIME_S.size)
    known = np.stack([np.ones(TIME_S.size), np.sin(TIME_S)], axis=1)
    return ScoreTest(noise + structure, known, np.ones(TIME_S.size, np.bool_))


def best_of(left: ScoreTest, group: Group) -> Score:
    return left.score(group.columns())


def by_word(left: ScoreTest) -> dict[str, Group]:
    return {group.words[0]: group for group in lines(left, TIME_S, DT, STEP)}


def test_a_jump_is_found_at_its_instant() -> None:
    left = left_of(0.5 * (TIME_S > 511.3))
    found = jump(left, TIME_S)
    assert found.words == ("time",)
    assert found.form == "a jump of the bias at 511 s"
    expected = 0.25 * 30000 * 18870 * 43130 / 62000 / 30000
    assert best_of(left, found).gain == pytest.approx(expected, rel=0.1)


def test_a_jump_in_a_gap_is_between_its_ends() -> None:
    found = jump(left_of(8.0 * (TIME_S > 340.0), 1), TIME_S)
    assert found.form == "a jump of the bias between 300 and 380 s"


def test_a_bump_is_found_with_its_width_even_across_a_gap() -> None:
    for at, width in ((150.0, 6.0), (345.0, 40.0), (600.0, 25.0)):
        shape = 0.6 * np.exp(-0.5 * ((TIME_S - at) / width) ** 2)
        left = left_of(shape)
        own = shape - shape.mean()
        seen = best_of(left, bump(left, TIME_S, DT))
        assert seen.gain == pytest.approx(float(own @ own), rel=0.15)


def test_lines_are_slow_swings_or_frequencies() -> None:
    swing = left_of(0.2 * np.sin(2 * np.pi * TIME_S / 77.0))
    group = by_word(swing)["time"]
    assert float(group.form.split()[-2]) == pytest.approx(77.0, rel=0.01)
    assert best_of(swing, group).gain == pytest.approx(0.2**2 / 2 * TIME_S.size, rel=0.1)
    line = left_of(0.05 * np.sin(2 * np.pi * 13.37 * TIME_S))
    found = by_word(line)["frequency"]
    assert found.form == "a line at 13.37 Hz"
    assert best_of(line, found).gain == pytest.approx(0.05**2 / 2 * TIME_S.size, rel=0.5)


def test_what_swings_only_while_it_moves_so_is_no_line() -> None:
    left = left_of(0.5 * np.sin(2 * np.pi * 1.5 * TIME_S) * ((TIME_S > 100) & (TIME_S < 180)))
    assert "frequency" not in by_word(left)


def test_rows_too_far_apart_for_lines_have_swings_alone() -> None:
    time_s = np.arange(120) * 10.5
    swing = np.random.default_rng(0).standard_normal(120) + 3.0 * np.sin(2 * np.pi * time_s / 200.0)
    left = ScoreTest(swing, np.ones((120, 1)), np.ones(120, np.bool_))
    (only,) = lines(left, time_s, 10.5, np.zeros(120, np.int64))
    assert only.words == ("time",)
    assert float(only.form.split()[-2]) == pytest.approx(200.0, rel=0.02)


def test_in_noise_nothing_is_significant() -> None:
    for seed in range(5):
        left = left_of(np.zeros(TIME_S.size), seed)
        for group in (jump(left, TIME_S), bump(left, TIME_S, DT), *lines(left, TIME_S, DT, STEP)):
            assert best_of(left, group).log_p + np.log(group.places) > np.log(1e-3)


@pytest.mark.parametrize("cells", [1.0, 7.3, 60.0])
def test_a_blur_is_that_of_a_gaussian_with_nothing_beyond_the_ends(cells: float) -> None:
    columns = np.cumsum(np.random.default_rng(2).standard_normal((1000, 3)), axis=0)
    expected = gaussian_filter1d(columns, cells, axis=0, mode="constant", truncate=8.0)
    blur = _Blurred(columns, farthest=480)
    np.testing.assert_allclose(blur(cells, slice(None)), expected, atol=1e-6 * np.abs(columns).max())
    np.testing.assert_allclose(blur(cells, slice(1, 2)), expected[:, 1:2], atol=1e-6 * np.abs(columns).max())
