"""Warm-up after a turn-on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.metrology.observations import Settings
from benchctl.plan import PowerCycle, Static, Step
from tests.benchctl.metrology.altered import nan_in, results
from tests.benchctl.metrology.made_unit import MadeUnit
from tests.benchctl.metrology.short_plans import IDEAL, QUIET, soak, sweep

NAMES = ("warm_up_time", "warm_up_bias")


def turned_on(rest_s: float = 2400.0) -> list[Step]:
    return [soak(), PowerCycle(off_s=3600.0), Static(duration_s=rest_s, settle_s=0.0), *sweep()]


@pytest.mark.parametrize("tau_s", [25.0, 150.0, 600.0])
def test_size_and_time_are_those_of_the_exponential_from_the_moment_of_the_turn_on(tau_s: float) -> None:
    """25 s is not much more than a mean of the rest is long."""
    unit = replace(IDEAL, warm_up_v=3e-3, warm_up_tau_s=tau_s, white_v_per_sqrt_hz=1e-8)
    found = results(turned_on(), unit)
    size = 3600.0 * 3e-3 / 0.05
    assert found["warm_up_bias"].value == pytest.approx(size, rel=1e-4)
    assert found["warm_up_time"].value == pytest.approx(tau_s * np.log(size / 10.0), rel=1e-4)
    assert found["warm_up_time"].steps == (2, 3)


def test_a_unit_that_drifts_down_is_as_warm_as_one_that_drifts_up() -> None:
    unit = replace(IDEAL, warm_up_v=-3e-3, white_v_per_sqrt_hz=1e-8)
    assert results(turned_on(), unit)["warm_up_bias"].value == pytest.approx(216.0, rel=1e-4)


def test_warm_is_as_the_limits_define_it() -> None:
    unit = replace(IDEAL, warm_up_v=3e-3, white_v_per_sqrt_hz=1e-8)
    found = results(turned_on(), unit, settings=Settings(warm_deg_per_h=50.0))["warm_up_time"]
    assert found.value == pytest.approx(150.0 * np.log(216.0 / 50.0), rel=1e-4)


def test_a_unit_that_is_warm_at_once_is_so_at_most_at_the_first_look() -> None:
    found = results(turned_on(), IDEAL, seed=1)
    time, size = (found[name] for name in NAMES)
    assert (time.value, time.bound) == (pytest.approx(10.0, abs=0.1), "at most")
    assert size.uncertainty is not None
    assert size.uncertainty.says.key == "not_told_from_zero"
    assert [note.key for note in size.notes] == ["no_settling_seen"]


@pytest.mark.parametrize("seed", range(4))
def test_a_unit_that_is_warm_at_once_is_not_thought_to_have_been_far_off_before_anyone_looked(seed: int) -> None:
    """A settling of a few seconds would be over at the first mean; taken as possible, it made U hundreds of deg/h."""
    size = results(turned_on(), IDEAL, seed=seed)["warm_up_bias"]
    assert size.value is not None
    assert size.uncertainty is not None
    assert size.value <= size.uncertainty.expanded < 15.0


def test_a_settling_that_cannot_be_told_is_no_time() -> None:
    """Noise of 60 deg/h a mean: whether 10 deg/h were left, nobody can say."""
    unit = MadeUnit(warm_up_v=2e-4, white_v_per_sqrt_hz=1e-2)
    found = results(turned_on(), unit)
    assert found["warm_up_time"].refused is not None
    assert found["warm_up_time"].refused.key == "no_settling_seen"
    assert found["warm_up_bias"].uncertainty is not None
    assert found["warm_up_bias"].uncertainty.says.key == "not_told_from_zero"


def test_the_longest_rest_after_a_turn_on_counts() -> None:
    steps = [*turned_on(400.0), *turned_on(1500.0)[1:], *turned_on(400.0)[1:]]
    found = results(steps, QUIET)["warm_up_time"]
    rests = [number for number, step in enumerate(steps, 1) if step.kind == "static" and step.streamed_s == 1500.0]
    assert found.steps[-1] == rests[0]


@pytest.mark.parametrize(
    ("steps", "change", "why"),
    [
        ([soak(), Static(duration_s=900.0), *sweep()], None, "needs_power_on"),
        (turned_on(200.0), None, "needs_power_on"),
        ([soak(), PowerCycle(off_s=9.0), soak(), Static(duration_s=900.0), *sweep()], None, "needs_power_on"),
        (turned_on(), nan_in("gyro_v", "static"), "needs_power_on"),
        ([*turned_on()[:3], *sweep()[:1]], None, "needs_scale_factor"),
    ],
    ids=["no-cycle", "short", "soaked", "silent", "no-scale-factor"],
)
def test_what_is_lacking_is_said(steps: list, change: object, why: str) -> None:
    found = results(steps, QUIET, change=change)  # type: ignore[arg-type]
    for name in NAMES:
        assert found[name].refused is not None
        assert found[name].refused.key == why  # type: ignore[union-attr]
