"""A digitizer that cannot do exactly the rate of bench.toml: everything recorded is of the rate that it does."""

from pathlib import Path

import numpy as np
import pytest

from benchctl.bench import load_bench
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import Moment, Outcome, run_campaign
from benchctl.campaign.stop import StopRequest
from benchctl.plan import ConstantRate, Plan, Soak, Static, Step
from benchctl.recordings.exporting import export_open
from benchctl.recordings.reader import Recording, open_recording
from benchctl.reports.setup_section import facts

ASKED_HZ, ACTUAL_HZ = 3000.0, float(np.float32(10e6 / 3333))
STEPS = (Static(duration_s=2.0), Soak(setpoint_c=23.0, hold_s=60.0), ConstantRate(rate_dps=50.0, duration_s=30.0))


def run(folder: Path, stop: StopRequest | None = None, *steps: Step) -> Outcome:
    bench = load_bench("simulated")
    bench = bench.model_copy(update={"digitizer": bench.digitizer.model_copy(update={"sample_rate_hz": ASKED_HZ})})
    plan = Plan(procedure="mine", parameters={}, steps=steps or STEPS, calibrates=False, source="source")

    def look(moment: Moment) -> None:
        if stop is not None and moment.label.startswith("rate") and moment.doing == "recording":
            stop.ask("Ctrl-C")

    with open_bench(bench) as opened:
        return run_campaign(plan, opened, folder, stop=stop or StopRequest(), progress=look)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    outcome = run(tmp_path_factory.mktemp("rate") / "c")
    assert outcome.status == "complete"
    return open_recording(outcome.recording)


def test_steps_stamps_and_numbers_of_scans_are_of_the_rate_that_the_t7_does(recording: Recording) -> None:
    still, soak, turning = recording.infos
    assert (still.sample_rate_hz, soak.sample_rate_hz, turning.sample_rate_hz) == (ACTUAL_HZ, None, ACTUAL_HZ)
    assert (still.samples, turning.samples) == (6001, 90009)
    time_s = recording.step(turning.index)["time_s"]
    assert np.diff(time_s) == pytest.approx(1.0 / ACTUAL_HZ, abs=1e-9)
    assert turning.t_end - turning.t_start == pytest.approx(30.0, abs=1.0 / ACTUAL_HZ)


def test_a_rate_from_angles_and_stamps_is_the_tables(recording: Recording) -> None:
    turning = recording.step(recording.infos[2].index)
    angle_deg = np.unwrap(turning["encoder_deg"], period=360.0)
    slope_dps = np.polyfit(turning["time_s"] - turning["time_s"][0], angle_deg, 1)[0]
    assert slope_dps == pytest.approx(50.0, rel=2e-5)  # the asked rate would make it wrong by 1e-4


def test_reports_and_exports_state_the_actual_rate(recording: Recording, tmp_path: Path) -> None:
    assert dict(facts(recording.meta, recording.infos))["Sample rate"].replace("\N{NO-BREAK SPACE}", " ") == "3000.3 Hz"
    export_open(recording, tmp_path / "open")
    assert '"sample_rate_hz": 3000.300048828125' in (tmp_path / "open" / "recording.json").read_text(encoding="utf-8")


def test_a_step_that_was_stopped_has_the_actual_rate_too(tmp_path: Path) -> None:
    outcome = run(tmp_path / "c", StopRequest(), ConstantRate(rate_dps=50.0, duration_s=30.0))
    assert outcome.status == "interrupted"
    with open_recording(outcome.recording) as stopped:
        (info,) = stopped.infos
    assert (info.whole, info.sample_rate_hz) == (False, ACTUAL_HZ)
