"""Hysteresis in rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.plan import ConstantRate, Static, levels, rate_cycle
from tests.benchctl.metrology.altered import results
from tests.benchctl.metrology.short_plans import IDEAL, QUIET, soak, sweep

NAME = "hysteresis_rate"
CYCLE = list(rate_cycle(levels(100.0, 5), at_least_s=30.0, zero_s=60.0))


def test_it_is_the_largest_difference_of_both_legs_over_the_largest_output() -> None:
    """The made unit's loop is widest at low rates: 1 − (20/100)² of it at 20 deg/s."""
    unit = replace(IDEAL, hysteresis=60e-6, white_v_per_sqrt_hz=1e-9)
    found = results([soak(), *CYCLE], unit)[NAME]
    assert found.value == pytest.approx(60.0 * (1.0 - 0.2**2), rel=1e-4)
    loop = next(column for column in found.table if column.name == "up_less_down").values
    rates = np.array(next(column for column in found.table if column.name == "rate").values)
    assert rates.tolist() == [-80.0, -60.0, -40.0, -20.0, 20.0, 40.0, 60.0, 80.0]
    assert loop == pytest.approx(60.0 * (1.0 - (rates / 100.0) ** 2), rel=1e-3)


def test_a_gyro_that_remembers_nothing_cannot_be_told_from_zero() -> None:
    found = results([soak(), *CYCLE], IDEAL)[NAME]
    assert found.uncertainty is not None
    assert found.value is not None
    assert found.uncertainty.says.key == "not_told_from_zero"
    assert found.uncertainty.expanded >= found.value


def test_a_drift_of_the_bias_is_no_hysteresis() -> None:
    """The rests between take it off: the walk alone would be 20 times the loop."""
    unit = replace(IDEAL, walk_v_per_sqrt_s=3e-5)
    found = results([soak(), *CYCLE], unit)[NAME]
    assert found.value is not None
    assert found.uncertainty is not None
    assert found.uncertainty.says.key == "not_told_from_zero"


def test_the_cycle_that_goes_furthest_counts() -> None:
    small = list(rate_cycle(levels(50.0, 2), at_least_s=30.0, zero_s=60.0))
    steps = [soak(), *small, soak(), *CYCLE, soak(), *small]
    found = results(steps, QUIET)[NAME]
    first = len(small) + 3
    assert found.steps == tuple(range(first, first + len(CYCLE)))


@pytest.mark.parametrize(
    "steps",
    [
        [soak(), *sweep()],
        [soak(), Static(duration_s=60.0)],
        [soak(), *[ConstantRate(rate_dps=rate, duration_s=36.0) for rate in (100.0, 50.0, -100.0, -50.0)]],
    ],
    ids=["sweep", "rest", "down-only"],
)
def test_without_both_legs_it_is_refused(steps: list) -> None:
    found = results(steps, QUIET)[NAME]
    assert found.refused is not None
    assert found.refused.key == "needs_up_and_down"
