"""A digital gyro is a unit under test: a campaign over its real line, and the coefficients of its frames."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchctl.app.allan import allan
from benchctl.app.fit import FitResult, fit
from benchctl.bench import bench_of_text, template
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import run_campaign
from benchctl.plan import ConstantRate, Plan, Sine, Soak, Static, Step
from benchctl.recordings.reader import open_recording
from benchctl_instruments.simulated.settings import WorldSettings

RATE_HZ = 250.0
TRUTH = WorldSettings().gyro


def _steps() -> tuple[Step, ...]:
    turns = (ConstantRate(rate_dps=rate, duration_s=8.0) for rate in (-60.0, -40.0, -20.0, 20.0, 40.0, 60.0))
    swings = (Sine(amplitude_dps=60.0, frequency_hz=hz, cycles=6) for hz in (0.5, 0.8, 1.0))
    aside = Sine(amplitude_dps=60.0, frequency_hz=0.7, cycles=6, role="verify")
    return (
        Soak(setpoint_c=TRUTH.T0_c, hold_s=600.0),
        Static(duration_s=10.0),
        *turns,
        *swings,
        aside,
        Static(duration_s=10.0),
    )


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    bench = bench_of_text(f'{template()}[gyro]\nmodel = "kvh_dsp1760"\nframe_rate_hz = {RATE_HZ}\n', "the bench")
    plan = Plan(procedure="mine", parameters={}, steps=_steps(), calibrates=True, source="source")
    with open_bench(bench) as opened:
        return run_campaign(plan, opened, tmp_path_factory.mktemp("digital") / "c").recording


@pytest.fixture(scope="module")
def fitted(recorded: Path) -> FitResult:
    return fit([recorded])


def test_the_coefficients_are_those_of_a_gyro_that_states_its_rate(fitted: FitResult) -> None:
    parameters = fitted.coefficients["uncertainty"]["parameters"]
    assert (fitted.coefficients["output_unit"], parameters["K0_v_per_dps"]["unit"]) == ("deg/s", "(°/s)/(°/s)")
    assert abs(parameters["K0_v_per_dps"]["value"] - 1.0) < parameters["K0_v_per_dps"]["expanded"] < 1e-3
    assert abs(parameters["U0_v"]["value"]) < parameters["U0_v"]["expanded"] < 0.05
    truth = TRUTH.S_rad_per_dps
    assert abs(parameters["S_rad_per_dps"]["value"] - truth) < parameters["S_rad_per_dps"]["expanded"] < 1e-4
    assert fitted.error_percent["joint"] < 0.1


def test_the_delay_holds_the_gyros_own_and_the_transit_of_its_frames(fitted: FitResult) -> None:
    delay_s = fitted.coefficients["uncertainty"]["parameters"]["delay_s"]["value"]
    assert 0.0011 < delay_s < 0.0012 + 1.0 / RATE_HZ  # a stamp is late by an interval at the most


def test_the_budget_has_no_part_of_the_digitizers_volts(fitted: FitResult) -> None:
    parameters = fitted.coefficients["uncertainty"]["parameters"]
    sources = {part["source"] for name in ("K0_v_per_dps", "U0_v") for part in parameters[name]["budget"]}
    assert {"type A", "encoder", "time base"} <= sources
    assert not sources & {"ADC gain", "ADC offset"}


def test_the_allan_deviation_is_that_of_the_frames(recorded: Path) -> None:
    series = allan(recorded).analysis.series
    assert (series.unit, round(1.0 / series.interval_s)) == ("deg/s", RATE_HZ)
    with open_recording(recorded) as recording:
        assert recording.meta.output_unit == "V"  # what is stored is not changed
