"""Which kernels are taken, that both kinds give the same, and what they work in."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from benchctl.metrology.deviations import compiled
from benchctl.metrology.kernels import by_numpy, room

_IN_A_NEW_PROCESS = """
import sys
import numpy as np
{before}
from benchctl.metrology.deviations import deviation
from benchctl.metrology.deviations import kernels_for
assert np.allclose(deviation(np.array([1.0, 2.0, 4.0, 3.0]), np.array([1])), np.sqrt(1.0))
print(kernels_for({differences}).squares.__module__, "numba" in sys.modules)
"""


def taken(differences: int, before: str = "") -> str:
    program = _IN_A_NEW_PROCESS.format(differences=differences, before=before)
    return subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout.strip()


def test_numba_is_not_loaded_for_a_record_of_ordinary_length() -> None:
    assert taken(100_000_000) == "benchctl.metrology.kernels False"


def test_without_numba_numpy_does_everything() -> None:
    assert taken(10**10, "sys.modules['numba'] = None").startswith("benchctl.metrology.kernels")


def test_numba_is_taken_where_it_pays_or_is_loaded_already() -> None:
    pytest.importorskip("numba")
    assert taken(10**10) == "benchctl.metrology.kernels_numba True"
    assert taken(1, "import numba") == "benchctl.metrology.kernels_numba True"


@pytest.mark.parametrize("rows", [1, 2, 3, 4])
def test_running_sums_are_the_same_bit_for_bit(rows: int) -> None:
    pytest.importorskip("numba")
    values = np.random.default_rng(1).standard_normal((rows, 40_000))
    sums = np.empty((2, *values.shape))
    lasts = [one.running_sums(values, 0.3, sums[k]) for k, one in enumerate((by_numpy(), compiled()))]
    assert np.array_equal(sums[0], sums[1])
    assert np.array_equal(lasts[0], lasts[1])
    assert np.array_equal(lasts[0], sums[0, :, -1])
    assert np.array_equal(sums[0], np.cumsum(values - 0.3, axis=1))


@pytest.mark.parametrize("points", [1, 7, 8, 100_003, 10_000_001])
def test_room_begins_at_a_cache_line_and_has_the_points_asked_for(points: int) -> None:
    kept = [room(points) for _ in range(3)]
    assert [one.__array_interface__["data"][0] % 64 for one in kept] == [0, 0, 0]
    assert {one.shape for one in kept} == {(points,)}
    assert all(one.flags.c_contiguous and one.dtype == np.float64 for one in kept)


@pytest.mark.parametrize("begin_end", [(0, 500), (100, 400), (480, 500), (499, 500)])
def test_squares_are_of_the_differences_that_begin_where_one_asks(begin_end: tuple[int, int]) -> None:
    phase, lags = np.cumsum(np.random.default_rng(5).standard_normal(500)), np.array([1, 2, 4, 10, 60, 120, 240])
    begin, end = begin_end
    expected = []
    for lag in lags.tolist():
        second = (phase[2 * lag :] - 2.0 * phase[lag:-lag] + phase[: -2 * lag])[begin:end]
        expected.append(float(second @ second))
    for kernels in (by_numpy(), compiled()):
        assert kernels.squares(phase, lags, begin, end) == pytest.approx(expected, rel=1e-12, abs=0.0)
