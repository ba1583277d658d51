"""Threshold and resolution: by a gyro with a dead zone of known width."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchctl.plan import ConstantRate, Static, Step, small_steps
from tests.benchctl.metrology.altered import results
from tests.benchctl.metrology.gyro_tests.test_scale_factor import EARTH_VERTICAL_DPS
from tests.benchctl.metrology.short_plans import IDEAL, QUIET, soak, sweep

STEPS_DPS = (0.005, 0.01, 0.02, 0.03, 0.045, 0.06)


def about(base_dps: float, steps_dps: tuple[float, ...] = STEPS_DPS) -> list[Step]:
    return [soak(), *sweep(), *small_steps(base_dps, steps_dps, run_s=60.0)]


def test_the_threshold_lies_where_half_of_the_rate_shows_in_the_worse_direction() -> None:
    """At rest the Earth's rate lies inside the zone: one way it helps, the other way there is further to go.

    Of a rate r the response there is 1 − (zone + Earth)/r, one half at twice both.
    """
    unit = replace(IDEAL, dead_dps=0.015, white_v_per_sqrt_hz=1e-9)
    found = results(about(0.0), unit)["threshold"]
    true = 3600.0 * 2.0 * (0.015 + EARTH_VERTICAL_DPS)
    assert found.value == pytest.approx(true, rel=1e-3)
    assert found.uncertainty is not None
    assert found.uncertainty.expanded > 3600.0 * 0.005  # the rates tried are apart
    assert found.bound == ""


def test_a_gyro_without_a_dead_zone_is_only_known_to_show_the_smallest_rate_tried() -> None:
    for name, base_dps in (("threshold", 0.0), ("resolution", 10.0)):
        found = results(about(base_dps), replace(IDEAL, white_v_per_sqrt_hz=1e-7))[name]
        assert (found.value, found.bound) == (pytest.approx(3600.0 * 0.005, rel=1e-3), "at most")


def test_a_gyro_that_shows_none_of_the_rates_tried_is_only_known_to_need_more() -> None:
    """Its threshold is 0.4 deg/s, and none of what was tried must pass for it."""
    found = results(about(0.0), replace(IDEAL, dead_dps=0.2))["threshold"]
    assert (found.value, found.bound) == (pytest.approx(3600.0 * 0.06, rel=1e-3), "at least")


def test_a_zone_about_rest_is_none_about_a_base_rate() -> None:
    found = results(about(10.0), replace(IDEAL, dead_dps=0.015, white_v_per_sqrt_hz=1e-7))["resolution"]
    assert found.bound == "at most"


def test_more_noise_than_the_rate_makes_the_threshold_uncertain_and_not_better() -> None:
    found = results(about(0.0), replace(IDEAL, white_v_per_sqrt_hz=2e-3))["threshold"]
    assert found.value is not None
    assert found.uncertainty is not None
    assert found.value + found.uncertainty.expanded > 3600.0 * 0.005


@pytest.mark.parametrize(
    ("steps", "name", "why"),
    [
        ([soak(), *sweep()], "threshold", "needs_small_rates"),
        ([soak(), *sweep()], "resolution", "needs_rate_steps"),
        (about(0.0), "resolution", "needs_rate_steps"),
        (about(10.0), "threshold", "needs_small_rates"),
        (about(0.0, (0.01, 0.02)), "threshold", "needs_small_rates"),
        (about(0.0, (0.7, 0.8, 0.9)), "threshold", "needs_small_rates"),
        (
            [soak(), *[ConstantRate(rate_dps=rate, duration_s=60.0) for rate in (0.01, 0.02, 0.03)], soak(), *sweep()],
            "threshold",
            "needs_small_rates",
        ),
        ([soak(), Static(duration_s=60.0)], "threshold", "needs_small_rates"),
    ],
)
def test_what_is_lacking_is_said(steps: list, name: str, why: str) -> None:
    found = results(steps, QUIET)[name]
    assert found.value is None
    assert found.refused is not None
    assert found.refused.key == why
