"""A digital gyro is a unit under test: a campaign over its real line, and the coefficients of its frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchctl.app.accept import accept
from benchctl.app.allan import allan
from benchctl.app.compare import NEW, compare_with_models
from benchctl.app.compensate import compensate
from benchctl.app.diagnose import diagnose
from benchctl.app.fit import FitResult, fit
from benchctl.bench import bench_of_text, template
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import run_campaign
from benchctl.metrology.limit_file import limits_of_text
from benchctl.plan import ConstantRate, Plan, Sine, Soak, Static, Step
from benchctl.recordings.exporting import export_csv
from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import verify
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import UsageError
from benchctl_instruments.simulated.settings import WorldSettings

RATE_HZ = 250.0
CONCEALED_S = 0.012
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


def _run(folder: Path, steps: tuple[Step, ...], more: str = "") -> Path:
    text = f'{template()}[gyro]\nmodel = "kvh_dsp1760"\nframe_rate_hz = {RATE_HZ}\n{more}'
    plan = Plan(procedure="mine", parameters={}, steps=steps, calibrates=True, source="source")
    with open_bench(bench_of_text(text, "the bench")) as opened:
        return run_campaign(plan, opened, folder).recording


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _run(tmp_path_factory.mktemp("digital") / "c", _steps())


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


def test_the_coefficients_compensate_the_frames_they_came_from(
    recorded: Path, fitted: FitResult, tmp_path: Path
) -> None:
    done = compensate(recorded, fitted.write(tmp_path).files["coefficients"], tmp_path / "c.h5")
    assert f"a rate belongs to its stamp less {1e3 * done.values()['delay_s']:.4g} ms" in str(done)
    with open_recording(done.recording) as recording:
        turns = [info for info in recording.infos if info.kind == "constant_rate"]
        assert turns
        for info in turns:
            step = recording.step(info.index)
            assert "compensated_dps" not in step.channels
            middle = slice(len(step["frame_time_s"]) // 2, None)
            earth = fitted.coefficients["earth_rate_dps"]
            assert step["frame_compensated_dps"][middle].mean() - earth == pytest.approx(info.rate_dps, abs=0.02)
    assert verify(done.recording) == []


def test_a_sample_that_the_gyro_does_not_vouch_for_has_no_compensated_rate(
    recorded: Path, fitted: FitResult, tmp_path: Path
) -> None:
    with open_recording(recorded) as recording:
        steps = list(recording.steps())
        steps[3]["frame_status"][100:103] = 256.0
        write_recording(tmp_path / "r.h5", recording.meta, steps)
    done = compensate(tmp_path / "r.h5", fitted.write(tmp_path).files["coefficients"], tmp_path / "c.h5")
    assert done.applied.outside >= 3
    with open_recording(done.recording) as recording:
        step = recording.step(steps[3].info.index)
        export_csv(recording, tmp_path / "csv")
    assert np.flatnonzero(np.isnan(step["frame_compensated_dps"])).tolist() == [100, 101, 102]
    assert not step["frame_compensated_valid"][100:103].any()
    first_lines = [path.read_text().split("\n", 1)[0] for path in (tmp_path / "csv").glob("*_frames.csv")]
    assert all("frame_compensated_dps" in line for line in first_lines)
    assert first_lines


def test_the_acceptance_tests_are_those_of_the_frames(recorded: Path) -> None:
    text = '[settings]\nrest_s = 9.0\n[limits.scale_factor]\nlow = 0.97\nhigh = 1.0\nunit = "1"\n'
    found = accept(recorded, limits_of_text(text, Path("limits.toml")))
    results = {one.measured.name: one for one in found.tests}
    assert (found.verdict, results["scale_factor"].measured.unit) == ("PASS", "1")
    assert found.values()["tests"][0]["unit"] == "1"


@pytest.mark.slow
def test_a_concealed_delay_of_the_frames_is_fitted_and_diagnosed(fitted: FitResult, tmp_path: Path) -> None:
    fast = (
        Sine(amplitude_dps=50.0, frequency_hz=4.0, cycles=30),
        Sine(amplitude_dps=22.0, frequency_hz=9.0, cycles=70),
    )
    late = _run(tmp_path / "c", (*_steps(), *fast), f"[effects.timing_offset]\noffset_s = {CONCEALED_S}\n")
    own, found = (one.coefficients["uncertainty"]["parameters"]["delay_s"] for one in (fitted, fit([late])))
    assert found["value"] - own["value"] == pytest.approx(CONCEALED_S, abs=own["expanded"] + found["expanded"])
    findings = {one.effect: one for one in diagnose([late]).findings}
    offset = findings["timing_offset"].parameters["offset_s"]
    assert offset.low - 1e-5 < found["value"] < offset.high + 1e-5


def test_it_is_compared_with_a_model_of_its_rate(recorded: Path, tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text(
        'format = "benchctl-model/1"\nrecording = ""\n[simulation]\nK0_v_per_dps = 1.0\nU0_v = 0.0\nT0_c = 20.0\n'
        "k_T = []\nk_omega = []\nnoise_v_rms = 0.01\noutput_limit_v = 350.0\n"
    )
    compared = compare_with_models(recorded, tmp_path / "model.toml")
    assert compared.unit == "°/s"
    # a straight line: at 60 °/s the sine falls short by 0.73 °/s
    assert 0.1 < compared.parting.rms_v[NEW] < 1.0


def test_the_drive_is_diagnosed_from_the_scans(recorded: Path) -> None:
    with pytest.raises(UsageError, match=r"torque_nm together; it has .*frame_time_s"):
        diagnose([recorded], part="drive")
