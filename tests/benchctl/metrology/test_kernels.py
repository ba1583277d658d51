"""Which kernels are taken, and that both kinds give the same."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from benchctl.metrology.kernels import by_numpy, compiled

_IN_A_NEW_PROCESS = """
import sys
import numpy as np
{before}
from benchctl.metrology.deviations import deviation
from benchctl.metrology.kernels import kernels_for
assert np.allclose(deviation(np.array([1.0, 2.0, 4.0, 3.0]), np.array([1]), 1.0), np.sqrt(1.0))
print(kernels_for({differences}).squares.__module__, "numba" in sys.modules)
"""


def taken(differences: int, before: str = "") -> str:
    program = _IN_A_NEW_PROCESS.format(differences=differences, before=before)
    return subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout.strip()


def test_numba_is_not_loaded_for_a_record_of_ordinary_length() -> None:
    assert taken(100_000_000) == "benchctl.metrology.kernels_numpy False"


def test_without_numba_numpy_does_everything() -> None:
    assert taken(10**10, "sys.modules['numba'] = None").startswith("benchctl.metrology.kernels_numpy")


def test_numba_is_taken_where_it_pays_or_is_loaded_already() -> None:
    pytest.importorskip("numba")
    assert taken(10**10) == "benchctl.metrology.kernels_numba True"
    assert taken(1, "import numba") == "benchctl.metrology.kernels_numba True"


def test_running_sums_are_the_same_bit_for_bit() -> None:
    pytest.importorskip("numba")
    values = np.random.default_rng(1).standard_normal(40_000)
    sums = np.empty((2, values.size))
    lasts = [one.running_sum(values, 0.3, 0.1, sums[k]) for k, one in enumerate((by_numpy(), compiled()))]
    assert np.array_equal(sums[0], sums[1])
    assert lasts[0] == lasts[1] == sums[0, -1]
