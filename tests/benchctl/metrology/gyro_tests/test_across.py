"""Misalignment by a unit mounted across."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.plan import Mount, Static, Step
from tests.benchctl.metrology.altered import results
from tests.benchctl.metrology.short_plans import IDEAL, soak, sweep

NAME = "misalignment"
ACROSS: list[Step] = [soak(), *sweep(), Mount(position="across"), *sweep(), Mount(position="along")]


@pytest.mark.parametrize("tilt_rad", [3e-3, -8e-3, 0.5])
def test_it_is_the_angle_that_the_axis_leans_towards_the_tables(tilt_rad: float) -> None:
    unit = replace(IDEAL, misalignment_rad=tilt_rad, white_v_per_sqrt_hz=1e-9)
    found = results(ACROSS, unit)[NAME]
    assert found.value == pytest.approx(1e3 * tilt_rad, rel=1e-5)
    assert found.steps == tuple(range(15, 27))


def test_the_fixtures_own_error_stands_in_the_budget() -> None:
    found = results(ACROSS, IDEAL)[NAME]
    assert found.uncertainty is not None
    fixture = found.uncertainty.contributors[0]
    assert (fixture.source, fixture.kind) == ("fixture", "B")
    assert fixture.standard == pytest.approx(1e3 * np.deg2rad(0.1), rel=1e-6)


def test_a_unit_that_nobody_turned_is_a_right_angle_off_and_no_crash() -> None:
    """All of the rate is felt, by noise a little more than all."""
    for seed in range(4):
        found = results(ACROSS, replace(IDEAL, misalignment_rad=np.pi / 2), seed=seed)[NAME]
        assert found.value == pytest.approx(1e3 * np.pi / 2, rel=0.01)


@pytest.mark.parametrize(
    ("steps", "why"),
    [
        ([soak(), *sweep()], "needs_across"),
        ([soak(), *sweep(), Mount(position="across"), Static(duration_s=60.0)], "needs_across"),
        ([soak(), Mount(position="across"), *sweep()], "needs_scale_factor"),
    ],
)
def test_what_is_lacking_is_said(steps: list, why: str) -> None:
    found = results(steps, IDEAL)[NAME]
    assert found.refused is not None
    assert found.refused.key == why
