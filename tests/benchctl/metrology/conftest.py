"""What the tests of this folder share: the covariances of Allan variances, which depend on a record's length alone."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

from benchctl.metrology import allan
from benchctl_instruments.arrays import IntArray

Scatter = allan.AllanScatter


@cache
def _made(factors: tuple[int, ...], samples: int, interval_s: float) -> Scatter:
    return Scatter(np.array(factors, dtype=np.int64), samples, interval_s)


def _once(factors: IntArray, samples: int, interval_s: float) -> Scatter:
    return _made(tuple(factors.tolist()), samples, interval_s)


@pytest.fixture(scope="module", autouse=True)
def scatter_of_a_length_made_once() -> Iterator[None]:
    """Most of an analysis is their making, the same for every record of a length: each length's are made once."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(allan, "AllanScatter", _once)
        yield
