from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.signal import lfilter

from benchctl.diagnosis.search.pull import between, paid, peaks, unweighted
from benchctl.diagnosis.search.scan_mains import mains_places
from tests.benchctl.diagnosis.pulled import pulled

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class HighPass:
    """A whitening that forgets a level within some twenty rows."""

    weight: FloatArray
    time_s: FloatArray

    def __call__(self, column: FloatArray) -> FloatArray:
        white: FloatArray = lfilter([1.0, -1.0], [1.0, -0.95], column)
        return white * self.weight


def _high_pass(rows: int) -> Any:
    return HighPass(weight=np.ones(rows), time_s=np.zeros(0))


def test_run_from_its_end_to_its_beginning_a_whitening_is_its_transpose() -> None:
    one, other = np.random.default_rng(7).standard_normal((2, 500))
    whitener = _high_pass(500)
    backwards = unweighted(whitener, other[::-1])[::-1]
    assert float(whitener(one) @ other) == pytest.approx(float(one @ backwards), rel=1e-12)


@pytest.mark.parametrize("frequency_hz", [0.4, 17.0])
def test_a_line_has_the_gain_that_the_whitening_leaves_it(frequency_hz: float) -> None:
    rows = 20_000
    time_s, whitener = np.arange(rows, dtype=np.float64) * 0.01, _high_pass(rows)
    line = whitener(np.sin(2 * np.pi * frequency_hz * time_s))
    white = np.random.default_rng(8).standard_normal(rows) + 0.3 * line
    best = mains_places(pulled(white, whitener=whitener), time_s, 0.01, np.zeros(rows, np.int64), 0.1, 1)[0]
    assert best.value == pytest.approx(frequency_hz, abs=1e-3)
    assert best.gain == pytest.approx(float(white @ line) ** 2 / float(line @ line), rel=0.05)


def test_louder_places_pay_by_how_much_louder_they_are() -> None:
    assert paid(1000.0, 40.0, 0.8) == 1000.0
    assert 40.0 - 2.0 * math.log(paid(1000.0, 40.0, 1.25)) == pytest.approx(32.0 - 2.0 * math.log(1000.0))


def test_peaks_come_in_the_order_of_their_height_and_stand_apart() -> None:
    gain = np.array([0.0, 3.0, 9.0, 8.0, 0.0, 0.0, 5.0, 0.0])
    assert peaks(gain, 5, 1) == [2, 6]
    assert peaks(gain, 1, 1) == [2]
    assert peaks(np.zeros(4), 3, 1) == []


def test_the_top_of_a_parabola_is_found_between_its_points() -> None:
    at = np.arange(7.0)
    assert between(5.0 - (at - 3.3) ** 2, 3) == pytest.approx(3.3)
    assert between(at, 6) == 6.0
