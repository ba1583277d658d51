from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchctl.diagnosis.residual.groups import groups_of
from benchctl.diagnosis.residual.score_test import ScoreTest
from benchctl.diagnosis.result import COORDINATES
from benchctl_instruments.arrays import FloatArray

N = 8000


def coordinates() -> dict[str, FloatArray]:
    time = np.linspace(0.0, 400.0, N)
    rate = 60.0 * np.sin(time)
    return {
        "time": time,
        "rate": rate,
        "abs_rate": np.abs(rate),
        "rate_sign": np.sign(rate),
        "acceleration": 60.0 * np.cos(time),
        "angle": np.mod(40.0 * time, 360.0),
        "gyro_temp": 20.0 + 30.0 * np.sin(time / 55.0),
        "gyro_temp_rate": 30.0 / 55.0 * np.cos(time / 55.0),
        "chamber_temp": np.full(N, np.nan),
        "output": 0.02 * rate,
        "step": time // 20.0,
    }


def test_every_word_is_one_of_the_contract() -> None:
    for group in groups_of(coordinates(), output=coordinates()["output"], reference_c=23.0):
        for word in group.words:
            assert word.split("*") == sorted(word.split("*"))
            assert set(word.split("*")) <= set(COORDINATES)


def test_what_is_not_known_or_never_changes_is_not_looked_at() -> None:
    known = coordinates() | {"gyro_temp": np.full(N, 23.0)}
    words = {word for group in groups_of(known, output=known["output"], reference_c=23.0) for word in group.words}
    assert not {word for word in words if "chamber_temp" in word}
    assert not {word for word in words if "gyro_temp" in word.split("*")}
    assert {"rate", "angle", "angle*rate", "time", "step", "rate*time", "rate*step"} <= words


def test_with_slow_noise_there_is_no_time_and_fewer_columns() -> None:
    known = coordinates()
    wide, narrow = (
        {
            (group.words[0], group.form): group.columns().shape[1]
            for group in groups_of(known, output=known["output"], reference_c=0.0, slow=slow)
        }
        for slow in (False, True)
    )
    assert not {word for word, _ in narrow if {"time", "step"} & set(word.split("*"))}
    assert sum(narrow.values()) < 0.6 * sum(wide[name] for name in narrow)


@pytest.mark.parametrize(
    ("word", "structure"),
    [
        ("rate", lambda c: np.sin(c["rate"] / 15.0)),
        ("abs_rate", lambda c: c["abs_rate"] ** 2),
        ("acceleration", lambda c: c["acceleration"] ** 3),
        ("gyro_temp", lambda c: np.exp(-(((c["gyro_temp"] - 5.0) / 6.0) ** 2))),
        ("gyro_temp*rate", lambda c: c["rate"] * np.exp(-(((c["gyro_temp"] - 5.0) / 6.0) ** 2))),
        ("angle", lambda c: np.cos(np.deg2rad(3 * c["angle"] + 20.0))),
        ("angle*gyro_temp", lambda c: c["rate"] * (c["gyro_temp"] - 23.0) * np.cos(np.deg2rad(c["angle"]))),
        ("time", lambda c: np.exp(-(((c["time"] - 100.0) / 30.0) ** 2))),
        ("rate*step", lambda c: c["rate"] * (c["step"] == 7)),
    ],
)
def test_a_smooth_function_of_a_coordinate_is_followed_by_its_columns(
    word: str, structure: Callable[[dict[str, FloatArray]], FloatArray]
) -> None:
    known = coordinates()
    shape = structure(known)
    left = ScoreTest(shape, np.ones((N, 1)), np.ones(N, np.bool_))
    shares = [
        left.score(group.columns()).drop / left.squares
        for group in groups_of(known, output=known["output"], reference_c=23.0)
        if group.words[0] == word
    ]
    assert max(shares) > 0.98
