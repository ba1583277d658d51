"""The runner on the simulated bench without wires: quick, and the same runner that hardware gets."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from benchctl.bench import Bench, load_bench
from benchctl.campaign.opened import OpenBench, open_bench
from benchctl.campaign.runner import Moment, run_campaign
from benchctl.campaign.stop import StopRequest
from benchctl.plan import ConstantRate, Plan, Sine, Soak, Static, Step, ThermalRamp
from benchctl.recordings.reader import open_recording
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import LinkError, SafetyError, UsageError
from benchctl_instruments.interfaces import ChamberReading, RateTable, TableReading

SOAK = Soak(setpoint_c=25.0, hold_s=600.0)


def plan_of(*steps: Step) -> Plan:
    return Plan(procedure="mine", parameters={}, steps=steps, calibrates=False, source="source")


@pytest.fixture
def opened() -> Iterator[OpenBench]:
    with open_bench(load_bench("simulated"), wires=False) as bench:
        yield bench


def _events(folder: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in (folder / "journal.jsonl").read_text(encoding="utf-8").splitlines()]


def test_a_plan_is_played_and_every_step_is_whole(opened: OpenBench, tmp_path: Path) -> None:
    moments: list[Moment] = []
    plan = plan_of(
        SOAK,
        Static(duration_s=4.0),
        ConstantRate(rate_dps=-60.0, duration_s=6.0, role="verify"),
        Sine(amplitude_dps=100.0, frequency_hz=0.5, cycles=3),
        ThermalRamp(from_c=25.0, to_c=26.0, ramp_c_per_min=1.0, rate_dps=10.0),
    )
    outcome = run_campaign(plan, opened, tmp_path / "c", progress=moments.append)
    assert (outcome.status, outcome.whole, outcome.error) == ("complete", 5, None)
    assert outcome.safe.problems == ()
    assert outcome.safe.chamber_setpoint_c == 23.0
    with open_recording(outcome.recording) as recording:
        infos = recording.infos
        assert recording.meta.status == "complete"
        assert [info.kind for info in infos] == ["soak", "static", "constant_rate", "sine", "thermal_ramp"]
        assert [info.samples for info in infos[1:]] == [2000, 3000, 3000, 30000]
        assert all(info.whole and info.gaps == 0 for info in infos)
        assert infos[2].role == "verify"
        assert infos[4].chamber_setpoint_c == 26.0
        turning = recording.step(3)
        slope_dps = np.polyfit(turning["time_s"], np.unwrap(turning["encoder_deg"], period=360.0), 1)[0]
        assert slope_dps == pytest.approx(-60.0, abs=0.01)
        stamps = np.concatenate([step["time_s"] for step in recording.steps() if step.info.kind != "soak"])
        assert np.all(np.diff(stamps) > 0)
        swinging = recording.step(4)
        rate_dps = np.gradient(np.unwrap(swinging["encoder_deg"], period=360.0), swinging["time_s"])
        assert np.max(np.abs(rate_dps)) == pytest.approx(100.0, abs=3.0)
        assert json.loads(recording.meta.provenance["parameters"]) == {}
        assert recording.meta.provenance["instruments_reached"] == "simulated, without wires"
    assert [moment.index for moment in moments] == sorted(moment.index for moment in moments)
    assert moments[-1].left_s < moments[0].left_s


def test_a_wish_to_stop_in_a_sine_brings_the_bench_to_rest_and_closes_the_recording_as_interrupted(
    opened: OpenBench, tmp_path: Path
) -> None:
    stop = StopRequest()

    def ask_in_the_sine(moment: Moment) -> None:
        if moment.label.startswith("sine") and moment.doing == "recording":
            stop.ask("Ctrl-C")

    plan = plan_of(SOAK, Sine(amplitude_dps=100.0, frequency_hz=0.5, cycles=100), Static(duration_s=5.0))
    outcome = run_campaign(plan, opened, tmp_path / "c", stop=stop, progress=ask_in_the_sine)
    assert (outcome.status, outcome.whole) == ("interrupted", 1)
    assert str(outcome.error) == "stopped by Ctrl-C"
    assert abs(opened.table.read().rate_dps) < 0.05
    assert opened.chamber.read().setpoint_c == 23.0
    with open_recording(outcome.recording) as recording:
        assert recording.meta.status == "interrupted"
        assert [info.whole for info in recording.infos] == [True, False]
        assert outcome.samples == recording.infos[1].samples > 0
    safe = [event for event in _events(tmp_path / "c") if event["kind"] == "safe"]
    assert safe[0]["reason"] == "stopped by Ctrl-C"


def test_a_table_that_passes_its_limit_is_stopped_and_the_recording_says_why(
    opened: OpenBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = type(opened.table).read

    def too_fast(table: RateTable) -> TableReading:
        reading = read(table)
        runaway = 400.0 if reading.rate_dps > 40.0 else reading.rate_dps
        return TableReading(angle_deg=0.0, rate_dps=runaway, acceleration_dps2=0.0)

    monkeypatch.setattr(type(opened.table), "read", too_fast)
    outcome = run_campaign(plan_of(ConstantRate(rate_dps=50.0, duration_s=5.0)), opened, tmp_path / "c")
    assert outcome.status == "aborted"
    assert "400.00 deg/s measured, the bench's limit is 300 deg/s" in str(outcome.error)
    monkeypatch.undo()
    assert abs(opened.table.read().rate_dps) < 0.05


def test_an_alarm_of_the_chamber_ends_the_run(
    opened: OpenBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alarmed = ChamberReading(temperature_c=25.0, setpoint_c=25.0, power_percent=0.0, alarms=("alarm 1 high",))
    monkeypatch.setattr(type(opened.chamber), "read", lambda chamber: alarmed)
    outcome = run_campaign(plan_of(SOAK), opened, tmp_path / "c")
    assert isinstance(outcome.error, SafetyError)
    assert "alarm 1 high" in str(outcome.error)


def test_a_chamber_that_falls_silent_ends_the_run_and_the_table_is_stopped_all_the_same(
    opened: OpenBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def silent(*_: object) -> ChamberReading:
        raise LinkError("chamber at tcp://x: no answer")

    def fall_silent(moment: Moment) -> None:
        if moment.doing == "recording":
            monkeypatch.setattr(type(opened.chamber), "read", silent)
            monkeypatch.setattr(type(opened.chamber), "go_to", silent)

    plan = plan_of(ConstantRate(rate_dps=50.0, duration_s=100.0))
    outcome = run_campaign(plan, opened, tmp_path / "c", progress=fall_silent)
    assert outcome.status == "aborted"
    assert str(outcome.error).startswith("chamber: no news for")
    assert "the bench is not known to be at rest: chamber: chamber at tcp://x" in str(outcome.error)
    assert outcome.safe.problems == ("chamber: chamber at tcp://x: no answer",)
    assert outcome.safe.rate_dps is not None
    assert abs(outcome.safe.rate_dps) < 0.05


def test_a_fault_of_the_program_brings_the_bench_to_rest_before_it_goes_up(opened: OpenBench, tmp_path: Path) -> None:
    def broken(moment: Moment) -> None:
        if moment.doing == "recording":
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_campaign(plan_of(ConstantRate(rate_dps=50.0, duration_s=100.0)), opened, tmp_path / "c", progress=broken)
    assert abs(opened.table.read().rate_dps) < 0.05
    with open_recording(tmp_path / "c") as recording:
        assert recording.meta.status == "aborted"


def test_a_plan_beyond_the_limits_is_refused_before_anything_is_written(opened: OpenBench, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="the bench's limit is 300 deg/s"):
        run_campaign(plan_of(ConstantRate(rate_dps=500.0, duration_s=1.0)), opened, tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_two_runs_with_one_seed_record_the_same_samples_and_another_seed_other_ones(tmp_path: Path) -> None:
    def recorded(seed: int, name: str) -> FloatArray:
        bench: Bench = load_bench("simulated").with_seed(seed)
        with open_bench(bench, wires=False) as opened:
            outcome = run_campaign(plan_of(Static(duration_s=2.0)), opened, tmp_path / name)
        with open_recording(outcome.recording) as recording:
            return recording.step(1)["gyro_v"]

    first = recorded(1, "a")
    assert np.array_equal(first, recorded(1, "b"))
    assert not np.array_equal(first, recorded(2, "c"))
