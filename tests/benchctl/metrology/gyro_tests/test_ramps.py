"""Bias over the rate of temperature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.plan import Static, ThermalRamp
from benchctl.recordings.model import Step
from tests.benchctl.metrology.altered import nan_in, results, without
from tests.benchctl.metrology.short_plans import IDEAL, QUIET, soak, sweep

NAME = "bias_temperature_rate"


def ramp(from_c: float, to_c: float, per_min: float = 1.0, swing_dps: float = 0.0) -> ThermalRamp:
    return ThermalRamp(from_c=from_c, to_c=to_c, ramp_c_per_min=per_min, swing_dps=swing_dps)


UP_AND_DOWN = [soak(), *sweep(), ramp(20, 40), soak(40), ramp(40, 20)]


@pytest.mark.parametrize("shupe", [0.02, -0.02])
def test_it_is_the_bias_of_the_rate_once_that_of_the_temperature_is_off(shupe: float) -> None:
    unit = replace(IDEAL, shupe_v_s_per_c=shupe, bias_v_per_c=3e-5, bias_v_per_c2=-1e-6, white_v_per_sqrt_hz=1e-9)
    found = results(UP_AND_DOWN, unit)[NAME]
    assert found.value == pytest.approx(3600.0 / 60.0 * shupe / 0.05, rel=1e-3)
    assert [note.key for note in found.notes] == ["lag_included"]
    assert found.temperature_c == pytest.approx(30.0, abs=0.1)


def test_a_bias_of_temperature_alone_is_none_of_its_rate() -> None:
    unit = replace(IDEAL, bias_v_per_c=3e-5, bias_v_per_c2=-1e-6)
    found = results(UP_AND_DOWN, unit)[NAME]
    assert found.uncertainty is not None
    assert found.value is not None
    assert abs(found.value) < 2.0 * found.uncertainty.expanded


def test_ramps_of_other_rates_are_one_coefficient() -> None:
    unit = replace(IDEAL, shupe_v_s_per_c=0.02, white_v_per_sqrt_hz=1e-9)
    steps = [soak(), *sweep(), ramp(20, 40, 2.0), soak(40), ramp(40, 20, 0.5)]
    assert results(steps, unit)[NAME].value == pytest.approx(24.0, rel=1e-3)


def swinging(step: Step) -> Step:
    """The table swung during the ramps."""
    info = replace(step.info, amplitude_dps=40.0) if step.info.kind == "thermal_ramp" else step.info
    return Step(info, step.channels)


@pytest.mark.parametrize(
    ("steps", "change", "why"),
    [
        ([soak(), *sweep()], None, "needs_ramps"),
        ([soak(), *sweep(), ramp(20, 40)], None, "needs_ramps"),
        ([soak(), *sweep(), ramp(40, 20), ramp(40, 20)], None, "needs_ramps"),
        ([soak(), *sweep(), ramp(20, 20.5), ramp(20.5, 20)], None, "needs_ramps"),  # half a minute each
        ([soak(), *sweep(), ramp(20, 23), ramp(23, 20)], None, "needs_ramps"),  # a dozen means
        (UP_AND_DOWN, swinging, "needs_ramps"),
        (UP_AND_DOWN, without("gyro_temp_c"), "needs_ramps"),
        (UP_AND_DOWN, nan_in("gyro_temp_c", "thermal_ramp"), "needs_ramps"),
        (UP_AND_DOWN, nan_in("gyro_v", "thermal_ramp"), "needs_ramps"),
        ([soak(), Static(duration_s=60.0), ramp(20, 40), ramp(40, 20)], None, "needs_scale_factor"),
    ],
    ids=["none", "up", "down", "half-a-minute", "short", "swinging", "unmeasured", "lost", "silent", "no-scale-factor"],
)
def test_what_is_lacking_is_said(steps: list, change: object, why: str) -> None:
    found = results(steps, QUIET, change=change)[NAME]  # type: ignore[arg-type]
    assert found.refused is not None
    assert found.refused.key == why


def test_a_sample_that_is_missing_here_and_there_does_not_matter() -> None:
    def thinned(step: Step) -> Step:
        if step.info.kind == "thermal_ramp":
            step.channels["gyro_temp_c"][::7] = np.nan  # type: ignore[index]
        return step

    unit = replace(IDEAL, shupe_v_s_per_c=0.02, white_v_per_sqrt_hz=1e-9)
    assert results(UP_AND_DOWN, unit, change=thinned)[NAME].value == pytest.approx(24.0, rel=1e-3)
