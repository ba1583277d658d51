"""Ramps during which the table moves."""

from pathlib import Path

import numpy as np
import pytest

from benchctl.bench import load_bench
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import run_campaign
from benchctl.plan import Plan, ThermalRamp
from benchctl.plan.steps import faults
from benchctl.recordings.reader import open_recording

RAMP = ThermalRamp(from_c=23.0, to_c=24.0, ramp_c_per_min=2.0, swing_dps=40.0, swing_hz=0.5)


def test_a_table_that_swings_during_a_ramp_is_recorded_as_swinging(tmp_path: Path) -> None:
    plan = Plan(procedure="mine", parameters={}, steps=(RAMP,), calibrates=False)
    with open_bench(load_bench("simulated"), wires=False) as opened:
        outcome = run_campaign(plan, opened, tmp_path / "c")
    assert (outcome.status, outcome.whole) == ("complete", 1)
    with open_recording(outcome.recording) as recording:
        (info,) = recording.infos
        assert (info.kind, info.rate_dps, info.amplitude_dps, info.frequency_hz) == ("thermal_ramp", None, 40.0, 0.5)
        swinging = recording.step(info.index)
        rate_dps = np.gradient(np.unwrap(swinging["encoder_deg"], period=360.0), swinging["time_s"])
        assert np.sqrt(2.0) * np.std(rate_dps) == pytest.approx(40.0, rel=0.03)
        assert swinging["poll_chamber_temp_c"][-1] > 23.1


def test_a_ramp_may_turn_or_swing_and_not_both() -> None:
    assert list(faults(RAMP)) == []
    both = ThermalRamp(from_c=0.0, to_c=1.0, ramp_c_per_min=1.0, rate_dps=10.0, swing_dps=5.0)
    assert list(faults(both)) == ["rate_dps is 10 and swing_dps 5, expected one of them"]
    backwards = ThermalRamp(from_c=0.0, to_c=1.0, ramp_c_per_min=1.0, swing_dps=-5.0)
    assert list(faults(backwards)) == ["swing_dps is -5, expected 0 or more"]


def test_swinging_counts_against_the_limits() -> None:
    assert RAMP.peak_rate_dps == 40.0
    assert RAMP.peak_acceleration_dps2 == pytest.approx(40.0 * np.pi)


def test_a_ramp_asks_for_set_points_that_a_controller_can_read_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[float] = []
    ramp = ThermalRamp(from_c=1.0, to_c=-2.0, ramp_c_per_min=1.7)
    plan = Plan(procedure="mine", parameters={}, steps=(ramp,), calibrates=False)
    with open_bench(load_bench("simulated"), wires=False) as opened:
        go_to = opened.chamber.go_to
        monkeypatch.setattr(opened.chamber, "go_to", lambda celsius: (asked.append(celsius), go_to(celsius)))
        outcome = run_campaign(plan, opened, tmp_path / "c")
    assert outcome.status == "complete"
    assert len(asked) > 10
    assert [celsius for celsius in asked if celsius != round(celsius, 3)] == []
