"""Dead zone by a slow swing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.plan import Mount, Sine, Static, Step, slow_swing
from tests.benchctl.metrology.altered import nan_in, results, without
from tests.benchctl.metrology.short_plans import IDEAL, QUIET, soak, sweep

NAME = "dead_zone"
BIN_DPS = 0.95 * 2 * 0.1 / 25


def swung(*swings: Step) -> list[Step]:
    return [soak(), *sweep(), *swings]


@pytest.mark.parametrize("half_dps", [0.015, 0.03, 0.05])
def test_a_zone_is_as_wide_as_it_is_to_the_width_of_a_bin(half_dps: float) -> None:
    found = results(swung(slow_swing(0.1, 0.01, 2)), replace(IDEAL, dead_dps=half_dps))[NAME]
    assert found.value == pytest.approx(3600.0 * 2.0 * half_dps, abs=3600.0 * BIN_DPS)
    assert found.uncertainty is not None
    assert abs(found.value - 3600.0 * 2.0 * half_dps) < found.uncertainty.expanded  # type: ignore[operator]
    assert found.bound == ""


def test_without_a_zone_it_is_at_most_a_bin() -> None:
    found = results(swung(slow_swing(0.1, 0.01, 2)), IDEAL)[NAME]
    assert (found.value, found.bound) == (pytest.approx(3600.0 * BIN_DPS, rel=1e-6), "at most")
    response = np.array(next(column for column in found.table if column.name == "response").values)
    assert response == pytest.approx(np.ones(24), abs=0.2)


@pytest.mark.parametrize(
    "steps",
    [
        swung(),
        swung(slow_swing(0.1, 0.2, 4)),  # too fast
        swung(slow_swing(5.0, 0.01, 2)),  # too wide
        swung(Mount(position="across"), slow_swing(0.1, 0.01, 2)),
        [soak(), Static(duration_s=60.0), slow_swing(0.1, 0.01, 2)],
    ],
    ids=["none", "fast", "wide", "across", "no-scale-factor"],
)
def test_without_a_slow_swing_through_zero_it_is_refused(steps: list) -> None:
    found = results(steps, QUIET)[NAME]
    assert found.refused is not None
    assert found.refused.key == "needs_slow_swing"


@pytest.mark.parametrize("change", [nan_in("gyro_v", "sine"), without("encoder_deg", kind="sine")])
def test_a_swing_without_samples_is_none(change: object) -> None:
    found = results(swung(slow_swing(0.1, 0.01, 2)), QUIET, change=change)[NAME]  # type: ignore[arg-type]
    assert found.refused is not None


def test_a_swing_whose_samples_leave_bins_empty_is_none() -> None:
    swing = Sine(amplitude_dps=0.1, frequency_hz=0.1, cycles=1)
    found = results(swung(swing), replace(QUIET, sample_rate_hz=4.0))[NAME]
    assert found.refused is not None
    assert found.refused.key == "needs_slow_swing"
