"""A digital gyro on the simulated bench, over its real line, from bench.toml to the recording."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchctl.bench import Bench, bench_of_text, load_bench, template
from benchctl.campaign.opened import open_bench, simulated_bench
from benchctl.campaign.resume import past_of
from benchctl.campaign.runner import Moment, Outcome, run_campaign
from benchctl.campaign.stop import StopRequest
from benchctl.cli.sim import _write_bench
from benchctl.plan import ConstantRate, Plan, Sine, Soak, Static, Step
from benchctl.recordings.digests import digest_of
from benchctl.recordings.model import FRAME_CHANNELS
from benchctl.recordings.reader import Recording, open_recording
from benchctl.recordings.verify import verify
from benchctl.signals.under_test import under_test
from benchctl_instruments.errors import UsageError
from benchctl_instruments.simulated.clock import ScaledClock
from benchctl_instruments.simulated.faults.stream_faults import FrameFault

RATE_HZ = 250.0
TURN = ConstantRate(rate_dps=40.0, duration_s=8.0, settle_s=0.5)
SWING = Sine(amplitude_dps=30.0, frequency_hz=0.5, cycles=5, settle_cycles=1)
BENCH = load_bench("simulated")


def bench_with(model: str, *faults: FrameFault, more: str = "") -> Bench:
    text = template().replace("silence_s = 10.0", "silence_s = 2.0")
    text += f'[gyro]\nmodel = "{model}"\nframe_rate_hz = {RATE_HZ}\n{more}'
    return bench_of_text(text, "the bench").model_copy(update={"faults": faults})


def plan_of(*steps: Step) -> Plan:
    return Plan(procedure="mine", parameters={}, steps=steps, calibrates=False, source="source")


def run(bench: Bench, folder: Path, *steps: Step, **more: Any) -> Outcome:
    with open_bench(bench) as opened:
        return run_campaign(plan_of(*steps), opened, folder, **more)


def events(recording: Recording, kind: str) -> list[dict[str, Any]]:
    lines = recording.meta.provenance["journal"].splitlines()
    return [event for event in map(json.loads, lines) if event["kind"] == kind]


@dataclass(frozen=True, slots=True, kw_only=True)
class Made:
    """What a campaign with that gyro gave."""

    model: str
    outcome: Outcome
    recording: Recording


@pytest.fixture(scope="module", params=["kvh_dsp1760", "sensonor_stim300"])
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Made]:
    bench = bench_with(request.param, more='serial = "DG-7"\nsign = -1\n[gyro.options]\naxis = "y"\n')
    outcome = run(bench, tmp_path_factory.mktemp("made") / "c", TURN, SWING)
    with open_recording(outcome.recording) as recording:
        yield Made(model=request.param, outcome=outcome, recording=recording)


def test_every_streamed_step_has_frames_on_a_time_axis_of_their_own(made: Made) -> None:
    assert (made.outcome.status, made.outcome.error) == ("complete", None)
    assert verify(made.outcome.recording) == []
    for info in made.recording.infos:
        step = made.recording.step(info.index)
        assert (info.frame_rate_hz, info.frames_lost, info.frames_bad) == (RATE_HZ, 0, 0)
        assert {step[name].size for name in FRAME_CHANNELS} == {step["frame_time_s"].size}
        assert step["time_s"].size == info.samples
        times_s = step["frame_time_s"]
        assert np.diff(times_s) == pytest.approx(1.0 / RATE_HZ, abs=1e-9)
        assert info.t_start <= times_s[0] <= info.t_start + 2.0 / RATE_HZ
        assert info.t_end - 2.0 / RATE_HZ <= times_s[-1] < info.t_end
        assert set(step["frame_status"]) == {0.0}
        assert step["frame_temp_c"] == pytest.approx(23.0, abs=0.2)


def test_the_rate_is_the_tables_in_time_and_turned_round_where_the_bench_says_so(made: Made) -> None:
    turn, swing = made.recording.step(1), made.recording.step(2)
    assert turn["frame_rate_dps"].mean() == pytest.approx(-TURN.rate_dps, rel=0.01)
    analog = np.interp(swing["frame_time_s"], swing["time_s"], swing["gyro_v"] / 0.05)
    late_s = swing["frame_time_s"] - 1.0 / RATE_HZ  # a stamp is late by an interval at the most
    early = np.interp(late_s, swing["time_s"], swing["gyro_v"] / 0.05)
    lowest, highest = np.minimum(analog, early), np.maximum(analog, early)
    inside = slice(2, -2)
    assert (-swing["frame_rate_dps"] >= lowest - 0.4)[inside].all()
    assert (-swing["frame_rate_dps"] <= highest + 0.4)[inside].all()


def test_the_gyro_stands_among_the_instruments_and_nothing_was_amiss(made: Made) -> None:
    told = json.loads(made.recording.meta.provenance["instruments"])["gyro"]
    assert (told["driver"], told["bench_serial"]) == (made.model, "DG-7")
    for kind in ("frames_lost", "recovered", "silence", "gyro_fault", "gap"):
        assert events(made.recording, kind) == []


def test_a_listening_gyro_changes_nothing_of_what_the_digitizer_records(made: Made, tmp_path: Path) -> None:
    if made.model != "kvh_dsp1760":  # asking a STIM300 how it is configured takes bench time
        return
    without = run(BENCH, tmp_path / "c", TURN, SWING)
    with open_recording(without.recording) as recording:
        for info in recording.infos:
            names = recording.channels(info.index)
            assert not set(names) & set(FRAME_CHANNELS)
            assert (info.frame_rate_hz, info.frames_lost, info.frames_bad) == (None, None, None)
            alone, beside = recording.step(info.index), made.recording.step(info.index)
            assert {name: digest_of(alone[name]) for name in names} == {name: digest_of(beside[name]) for name in names}


@pytest.mark.slow
def test_a_silence_that_ends_with_the_step_is_counted_to_its_end(tmp_path: Path) -> None:
    fault = FrameFault(on="gyro", kind="frames_end", from_s=3.0)
    outcome = run(bench_with("kvh_dsp1760", fault), tmp_path / "c", ConstantRate(rate_dps=5.0, duration_s=4.0))
    with open_recording(outcome.recording) as recording:
        step, info = recording.step(1), recording.infos[0]
        assert info.frames_lost is not None
        assert abs(step["frame_time_s"].size + info.frames_lost - 4.0 * RATE_HZ) <= 1
        assert info.frames_lost > 100
        assert [event["frames"] for event in events(recording, "frames_lost")] == [info.frames_lost]


def test_a_gyro_that_stays_silent_stops_the_run_and_the_bench_rests(tmp_path: Path) -> None:
    fault = FrameFault(on="gyro", kind="frames_end", from_s=6.0)
    outcome = run(bench_with("kvh_dsp1760", fault), tmp_path / "c", replace(TURN, duration_s=30.0))
    assert outcome.status == "aborted"
    assert str(outcome.error).startswith("gyro: no news for ")
    assert "\n" not in str(outcome.error)
    assert outcome.safe.problems == ()
    with open_recording(outcome.recording) as recording:
        assert events(recording, "silence")
        assert [info.whole for info in recording.infos] == [False]
        assert recording.step(1)["frame_time_s"].size > RATE_HZ


@pytest.mark.parametrize("model", ["kvh_dsp1760", "sensonor_stim300"])
def test_a_soak_waits_for_the_digital_gyro_and_records_the_temperatures_that_it_states(
    tmp_path: Path, model: str
) -> None:
    outcome = run(bench_with(model), tmp_path / "c", Soak(setpoint_c=26.0, hold_s=60.0), TURN)
    assert (outcome.status, verify(outcome.recording)) == ("complete", [])
    with open_recording(outcome.recording) as recording:
        soak, unit = recording.step(1), under_test(recording).step(1)
    stated_c, thermistor_c = soak["poll_frame_temp_c"], soak["poll_gyro_temp_c"]
    # a second gyro of the same make in the same chamber
    assert np.isfinite(stated_c).all()
    assert np.ptp(stated_c) > 2.0
    assert stated_c == pytest.approx(thermistor_c, abs=0.05)
    assert unit["poll_gyro_temp_c"].tolist() == stated_c.tolist()


def test_a_gyro_that_falls_silent_in_a_soak_stops_the_run(tmp_path: Path) -> None:
    fault = FrameFault(on="gyro", kind="frames_end", from_s=300.0)
    outcome = run(bench_with("kvh_dsp1760", fault), tmp_path / "c", Soak(setpoint_c=26.0, hold_s=3600.0))
    assert outcome.status == "aborted"
    assert str(outcome.error).startswith("gyro: no news for ")


def test_a_stopped_run_keeps_its_frames_ends_its_thread_and_is_gone_on_with(tmp_path: Path) -> None:
    bench, stop = bench_with("kvh_dsp1760"), StopRequest()

    def look(moment: Moment) -> None:
        if moment.samples > 1000:
            stop.ask("Ctrl-C")

    outcome = run(bench, tmp_path / "c", TURN, stop=stop, progress=look)
    assert outcome.status == "interrupted"
    assert not [thread for thread in threading.enumerate() if thread.name == "gyro's frames"]
    with (
        past_of(tmp_path / "c", plan_of(TURN), bench) as past,
        open_bench(past.bench, elapsed_s=past.elapsed_s) as opened,
    ):
        again = run_campaign(plan_of(TURN), opened, tmp_path / "c", past=past)
    assert (again.status, again.whole) == ("complete", 1)
    with open_recording(again.recording) as recording:
        cut = next(info for info in recording.infos if not info.whole)
        assert cut.frames_lost == 0
        for info in recording.infos:
            if info.kind == "constant_rate":
                times_s = recording.step(info.index)["frame_time_s"]
                assert times_s.size > 3.0 * RATE_HZ
                assert info.t_start <= times_s[0] <= times_s[-1] < info.t_end
    assert verify(again.recording) == []


@pytest.mark.slow
def test_a_gyro_at_an_address_is_recorded_by_the_clock_on_the_wall(tmp_path: Path) -> None:
    turn = ConstantRate(rate_dps=20.0, duration_s=6.0)
    with simulated_bench(bench_with("kvh_dsp1760"), ScaledClock(2.0)) as servers:
        _write_bench(tmp_path / "sim.toml", bench_with("kvh_dsp1760"), servers.addresses, 2.0)
        with open_bench(load_bench(str(tmp_path / "sim.toml"))) as opened:
            outcome = run_campaign(plan_of(turn), opened, tmp_path / "c")
    assert outcome.error is None
    with open_recording(outcome.recording) as recording:
        step, info = recording.step(1), recording.infos[0]
        assert info.frames_lost is not None
        assert abs(step["frame_time_s"].size + info.frames_lost - turn.duration_s * RATE_HZ) <= 1
        assert np.median(np.diff(step["frame_time_s"])) == pytest.approx(1.0 / RATE_HZ)
        assert step["frame_rate_dps"].mean() == pytest.approx(turn.rate_dps, rel=0.01)


def test_frames_that_always_come_a_little_late_are_no_silence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a busy machine: at every look the freshest frame is already older than it should be."""
    monkeypatch.setattr("benchctl.campaign.frames.AGO", -1.0)
    outcome = run(bench_with("kvh_dsp1760"), tmp_path / "c", TURN)
    assert (outcome.status, outcome.error) == ("complete", None)


def test_another_gyro_is_another_campaign(tmp_path: Path) -> None:
    plan = plan_of(Static(duration_s=1.0))
    run(BENCH, tmp_path / "c", *plan.steps)
    with pytest.raises(UsageError, match="gyro"), past_of(tmp_path / "c", plan, bench_with("kvh_dsp1760")):
        pass
