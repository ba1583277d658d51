"""A bench whose digitizer is a scanning multimeter: static points, and what `check` refuses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchctl.app.fit import fit
from benchctl.bench import Bench, load_bench
from benchctl.campaign.check import problems
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import run_campaign
from benchctl.plan import ConstantRate, Plan, Sine, Soak, Static, Step, ThermalRamp
from benchctl.plan.find import find_procedure
from benchctl.recordings.reader import open_recording


def slow_bench(rate_table: str = "acutrol3000", **digitizer: Any) -> Bench:
    document = load_bench("simulated").model_dump()
    document["rate_table"]["model"] = rate_table
    document["digitizer"] |= {"model": "keithley_daq6510", "sample_rate_hz": 5.0, "adc_bits": 21, **digitizer}
    return Bench.model_validate(document)


def said(bench: Bench, *steps: Step) -> list[tuple[int, str]]:
    plan = Plan(procedure="mine", parameters={}, steps=steps, calibrates=False)
    return [(problem.step, problem.message) for problem in problems(plan, bench)]


REST = Static(duration_s=60.0)


def test_check_refuses_what_a_scanning_multimeter_cannot_record() -> None:
    swings = Sine(amplitude_dps=10.0, frequency_hz=1.0, cycles=5)
    turns = ConstantRate(rate_dps=10.0, duration_s=60.0)
    ramp = ThermalRamp(from_c=20.0, to_c=25.0, ramp_c_per_min=1.0)
    assert said(slow_bench(), REST, turns, ramp) == []
    assert said(slow_bench(), REST, swings) == [
        (
            2,
            "sine 10 at 1 Hz: swings, and the bench's digitizer, keithley_daq6510, counts no encoder and is too"
            " slow for sinusoids; take a procedure of constant rates (rate_sweep, temperature_sweep) or one at rest"
            " (static)",
        )
    ]
    assert said(slow_bench(sample_rate_hz=500.0), Soak(setpoint_c=20.0, hold_s=1.0), REST, REST) == [
        (
            2,
            "static: is recorded at 500 Hz, and the bench's digitizer, keithley_daq6510, scans at most 10 times a"
            " second; lower sample_rate_hz in [digitizer]; 1 more steps have this problem",
        )
    ]
    assert said(slow_bench("manual"), REST)[0][1].endswith("keithley_daq6510, counts none; take another")


def test_static_points_are_recorded_with_the_angle_of_the_table_and_fitted(tmp_path: Path) -> None:
    """The gyro of the simulated bench is U = U0 + K0/S·sin(S·ω): 50 mV/(deg/s), S = 4.5e-3, U0 = 12 mV."""
    plan = find_procedure("rate_sweep").expand({"soak_s": "60", "rates": "4", "verify": "no", "zero_s": "20"})
    bench = slow_bench()
    assert problems(plan, bench) == []
    with open_bench(bench) as opened:
        assert opened.identities["digitizer"].model == "MODEL DAQ6510"
        outcome = run_campaign(plan, opened, tmp_path / "c")
    assert (outcome.status, outcome.error) == ("complete", None)
    with open_recording(outcome.recording) as recording:
        for step in list(recording.steps())[1:]:
            time_s, angle_deg = step["time_s"], np.unwrap(step["encoder_deg"], period=360.0)
            rate_dps = np.polyfit(time_s, angle_deg, 1)[0]
            assert rate_dps == pytest.approx(step.info.rate_dps or 0.0, abs=2e-3), step.info.name
            assert np.diff(time_s) == pytest.approx(0.2)
            assert step.info.gaps == 0
    joint = fit([outcome.recording]).coefficients["joint"]["parameters"]
    assert joint["K0_v_per_dps"]["value"] == pytest.approx(0.05, rel=3e-4)
    assert joint["S_rad_per_dps"]["value"] == pytest.approx(4.5e-3, rel=1e-3)
    assert joint["U0_v"]["value"] == pytest.approx(0.012, abs=3e-4)


def test_the_procedure_static_records_rest_with_a_daq6510(tmp_path: Path) -> None:
    plan = find_procedure("static").expand({"soak_s": "60", "duration_s": "120"})
    with open_bench(slow_bench(options={"temperature": "rtd"}, thermistor_c_per_v=1.0)) as opened:
        outcome = run_campaign(plan, opened, tmp_path / "c")
    assert (outcome.status, outcome.samples) == ("complete", 600)
    with open_recording(outcome.recording) as recording:
        _, rest = recording.steps()
        assert np.ptp(rest["encoder_deg"]) < 1e-3
        assert np.mean(rest["gyro_v"]) == pytest.approx(0.012, abs=2e-3)
        assert np.std(rest["gyro_v"]) > 0.0
        assert np.mean(rest["gyro_temp_c"]) == pytest.approx(20.0, abs=0.5)
