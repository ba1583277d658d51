"""The overlapping Allan deviation of 10⁷ and 10⁸ samples beside allantools, on its octave and its decade grid.

The whole way from rates to deviations is timed, on all cores; that the digits are the same is checked first. A process
that has loaded numba, as one that works on record after record may, has the loops compiled; by itself the suite loads
it only from some 2·10⁹ differences on, because loading takes longer than these 10⁷ samples do. Both are measured; the
10⁸ samples as the suite does them by itself.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt

from benchctl.metrology.deviations import deviation
from benchctl_instruments.errors import UsageError
from tests.benchmarks.comparison import Comparison, alternating

SAMPLES = 10_000_000
MANY = 100_000_000
RATE_HZ = 100.0
GOAL = 0.05
SAME = {SAMPLES: 1e-12, MANY: 1e-11}
"""By so much of themselves the deviations may differ: allantools leaves the mean in what it adds up and loses digits.

Over 2²⁰ to 2²⁵ of 10⁸ such rates its deviations are 1e-13 to 6e-13 off those in extended precision, ours 1e-14.
"""
GRIDS = ("octave", "decade")
_TURNS, _TURNS_OF_MANY = 5, 2

FloatArray = npt.NDArray[np.float64]


def measured() -> list[Comparison]:
    """Each grid by numpy alone, and with numba where it is installed; then ten times the samples."""
    rates = gyro_rates(SAMPLES)
    with _without_numba():
        found = list(_by("numpy alone", rates))
    compiled = find_spec("numba") is not None
    if compiled:
        import numba  # noqa: F401

        found += _by("numba loaded", rates)
    del rates
    found += _by("with numba" if compiled else "by numpy", gyro_rates(MANY), ("octave",), _TURNS_OF_MANY)
    return found


def gyro_rates(samples: int) -> FloatArray:
    """White noise and a random walk about a bias, shape (samples,)."""
    chance = np.random.default_rng(7)
    rates: FloatArray = chance.standard_normal(samples)
    rates += 0.3 + 1e-4 * np.cumsum(chance.standard_normal(samples))
    return rates


def _by(means: str, rates: FloatArray, grids: Sequence[str] = GRIDS, turns: int = _TURNS) -> Iterator[Comparison]:
    oadev = _peer()
    for grid in grids:
        tau_s, expected, _, _ = oadev(rates, rate=RATE_HZ, data_type="freq", taus=grid)
        factors = np.round(tau_s * RATE_HZ).astype(np.int64)
        apart = float(np.max(np.abs(deviation(rates, factors) / expected - 1.0)))
        if not apart <= SAME[rates.size]:
            raise RuntimeError(f"{grid} grid, {means}: differs from allantools by {apart:.1e} of itself")
        ours_s, theirs_s = alternating(
            lambda factors=factors: _wall_s(lambda: deviation(rates, factors)),
            lambda grid=grid: _wall_s(lambda: oadev(rates, rate=RATE_HZ, data_type="freq", taus=grid)),
            turns,
        )
        name = f"overlapping Allan deviation, {rates.size:,} samples, {grid} grid ({factors.size} times), {means}"
        yield Comparison(name, ours_s, "s", "allantools", theirs_s, "<=", GOAL)


@contextmanager
def _without_numba() -> Iterator[None]:
    """As in a process that has not loaded it, whatever other benchmarks did."""
    loaded = sys.modules.pop("numba", None)
    try:
        yield
    finally:
        if loaded is not None:
            sys.modules["numba"] = loaded


def _peer() -> Callable[..., Any]:
    try:
        from allantools import oadev
    except ModuleNotFoundError as err:
        raise UsageError("allantools is not installed: pip install 'benchctl[benchmarks]'") from err
    return oadev  # type: ignore[no-any-return]


def _wall_s(work: Callable[[], object]) -> float:
    began_s = time.perf_counter()
    work()
    return time.perf_counter() - began_s
