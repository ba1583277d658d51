"""Following a campaign that runs: in this process, and in others that are killed, finish, or are really run."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchctl.bench import load_bench
from benchctl.campaign.soak import SOAK_CHANNELS, one_poll
from benchctl.dashboard.data import follower as module
from benchctl.dashboard.data.follower import Follower, Watch
from benchctl.recordings.campaign_folder import CampaignWriter, StepWriter, campaign_lock
from benchctl.recordings.recover import recover, reopen
from benchctl_instruments.interfaces import ChamberReading
from tests.benchctl.dashboard.data import brute
from tests.benchctl.recordings import made

ROOT = Path(__file__).resolve().parents[4]
PLAN = {
    "of": 2,
    "steps": [
        {
            "index": 1,
            "label": "soak",
            "kind": "soak",
            "t_start_s": 0,
            "t_end_s": 100,
            "streamed_s": 0,
            "setpoint_c": 20,
        },
        {"index": 2, "label": "rate", "kind": "constant_rate", "t_start_s": 100, "t_end_s": 200, "streamed_s": 90},
    ],
}
WATCH = Watch(("gyro_v", "rate_dps", "air_c"), 60.0, 500)


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[CampaignWriter]:
    one = CampaignWriter(tmp_path / "c", made.meta(status="running"))
    yield one
    one.release()


def _begin(writer: CampaignWriter, index: int, **changes: Any) -> StepWriter:
    return writer.begin_step(made.info(index, **changes), (*made.STREAMED, *made.POLLED))


def test_what_is_new_is_told_at_each_look(writer: CampaignWriter) -> None:
    follower = Follower(writer.folder)
    assert follower.look([WATCH])["doing"] == "preparing the bench"
    step = _begin(writer, 1)
    step.append(made.step(1).channels)
    step.flush()
    first = follower.look([WATCH])
    assert (first["status"], first["samples"], first["died"]) == ("running", 200, False)
    assert len(first["series"][0]["gyro_v"]["t_s"]) == 200
    step.append({**made.streamed(102.0, 50, seed=5), **made.polled(103.0)})
    step.flush()
    second = follower.look([WATCH, Watch(("gyro_temp_c",), 0.2, 10)])
    assert second["samples"] == 250
    assert second["now_s"] == 105.0
    assert second["values"]["gyro_v"] == made.streamed(102.0, 50, seed=5)["gyro_v"][-1]
    assert second["values"]["rate_dps"] == pytest.approx(50.0)
    assert second["values"]["air_c"] == 21.0
    assert second["values"]["setpoint_c"] is None
    time_s = np.concatenate((made.streamed(100.0, 200)["time_s"], made.streamed(102.0, 50)["time_s"]))
    assert second["series"][0]["gyro_v"]["t_s"] == time_s.tolist()
    assert second["series"][1]["gyro_temp_c"]["t_s"] == []
    json.dumps(second, allow_nan=False)


def test_the_noise_is_that_of_the_last_second_without_what_moves(writer: CampaignWriter) -> None:
    follower = Follower(writer.folder)
    step = _begin(writer, 1)
    channels = made.streamed(0.0, 1000)
    noise_v = 0.6e-3 * np.random.default_rng(5).standard_normal(1000)
    channels["gyro_v"] = 3.0 * np.sin(2 * np.pi * 0.2 * channels["time_s"]) + noise_v
    step.append(channels)
    step.flush()
    found = follower.look()
    assert found["values"]["noise_v_rms"] == pytest.approx(noise_v[-100:].std(), rel=0.15)
    assert found["noise_says"] == "rms of the third differences of gyro_v, over √20, of the last 100 samples (1 s)"


def test_what_was_recorded_before_is_in_the_window_too(writer: CampaignWriter) -> None:
    for index in (1, 2):
        step = _begin(writer, index)
        step.append({**made.streamed(10.0 * index, 500, seed=index), **made.polled(10.0 * index)})
        step.close(made.info(index, t_start=10.0 * index, t_end=10.0 * index + 5.0))
    third = _begin(writer, 3)
    third.append({**made.streamed(30.0, 300, seed=3), **made.polled(30.0)})
    third.flush()
    follower = Follower(writer.folder)
    found = follower.look([Watch(("gyro_v", "rate_dps"), 18.0, 200)])["series"][0]
    values = np.concatenate([made.streamed(10.0 * index, rows, seed=index)["gyro_v"] for index, rows in _ROWS])
    time_s = np.concatenate([made.streamed(10.0 * index, rows, seed=index)["time_s"] for index, rows in _ROWS])
    brute.assert_is_of(found["gyro_v"], time_s, values, 33.0)
    third.append({**made.streamed(33.0, 5, seed=3), **made.polled(33.0)})
    third.close(made.info(3, t_start=30.0, t_end=33.05))
    rates = follower.look([Watch(("rate_dps",), 18.0, 2000)])["series"][0]["rate_dps"]
    assert rates["t_s"][-5:] == made.streamed(33.0, 5)["time_s"].tolist()
    assert len(rates["t_s"]) == len(set(rates["t_s"]))


_ROWS = ((1, 500), (2, 500), (3, 300))


def test_steps_that_begin_and_end_between_two_looks_are_not_lost(writer: CampaignWriter) -> None:
    follower = Follower(writer.folder)
    follower.look([WATCH])
    for index in (1, 2, 3):
        step = _begin(writer, index)
        step.append({**made.streamed(10.0 * index, 100, seed=index), **made.polled(10.0 * index)})
        writer.step_over(step.close(made.info(index, t_start=10.0 * index, t_end=10.0 * index + 1.0)))
    found = follower.look([WATCH])
    assert found["samples"] == 300
    assert len(found["series"][0]["gyro_v"]["t_s"]) == len(found["series"][0]["rate_dps"]["t_s"]) == 300
    assert [event["kind"] for event in found["events"]] == ["whole"] * 3


def test_a_soak_says_what_it_waits_for(tmp_path: Path) -> None:
    soak = PLAN["steps"][0] | {"hold_s": 60.0, "tolerance_c": 0.3, "drift_c_per_min": 0.02}  # type: ignore[index]
    bench = load_bench("simulated")
    provenance = {"bench_toml": bench.text, "chamber_profile": bench.chamber_profile}
    writer = CampaignWriter(tmp_path / "soak", made.meta(status="running", provenance=provenance))
    writer.event("plan", bench_s=0.0, of=2, steps=[soak, PLAN["steps"][1]])  # type: ignore[index]
    writer.event("step", bench_s=1.0, index=1, number=1, name="soak")
    step = writer.begin_step(made.info(1, kind="soak", t_start=1.0), SOAK_CHANNELS)
    follower = Follower(writer.folder)

    def polled(time_s: float, air_c: float, gyro_c: float) -> dict[str, Any]:
        air = ChamberReading(temperature_c=air_c, setpoint_c=20.0, power_percent=0.0)
        step.append_point(one_poll(time_s, air, {"poll_gyro_temp_c": gyro_c, "poll_gyro_v": 0.0}))
        step.flush()
        return follower.look()

    far = polled(10.0, 22.0, 22.0)
    assert (far["doing"], far["soak"]["held_s"], far["soak"]["left_s"]) == ("going to the set point", None, 60.0)
    assert (far["soak"]["air_c"], far["soak"]["setpoint_c"], far["soak"]["tolerance_c"]) == (22.0, 20.0, 0.3)
    polled(100.0, 20.2, 20.2)
    within = polled(130.0, 20.1, 20.1)
    assert (within["doing"], within["soak"]["held_s"], within["soak"]["left_s"]) == ("soaking", 30.0, 30.0)
    assert (within["step"]["ends_s"], within["left_s"]) == (160.0, 130.0)  # 100 s were planned, 30 s still have to pass
    last = polled(170.0, 20.0, 20.0)
    assert (last["soak"]["held_s"], last["soak"]["left_s"]) == (70.0, 0.0)
    assert last["soak"]["drift_c_per_min"] == pytest.approx(-2.0 / 160.0 * 60.0)
    assert last["doing"].startswith("waiting for the gyro")
    assert polled(180.0, 20.4, 20.0)["soak"]["held_s"] is None
    writer.event("step", bench_s=190.0, index=2, number=2, name="rate")
    assert follower.look()["soak"] is None
    writer.release()


def test_step_plan_and_forecast_are_in_bench_time(writer: CampaignWriter) -> None:
    follower = Follower(writer.folder)
    writer.event("plan", bench_s=0.0, **PLAN)
    assert follower.look()["left_s"] == 200.0
    writer.event("step", bench_s=110.0, index=2, number=2, name="rate")
    step = _begin(writer, 2)
    step.append({**made.streamed(120.0, 1000), **made.polled(120.0)})
    step.flush()
    found = follower.look()
    expected = {"index": 2, "count": 2, "label": "rate", "kind": "constant_rate", "began_s": 110.0, "ends_s": 210.0}
    assert found["step"] == expected
    assert found["left_s"] == pytest.approx(100.0 - (129.99 - 110.0))
    assert found["doing"] == "recording"


def test_limits_are_held_against_what_is_measured(tmp_path: Path) -> None:
    bench = load_bench("simulated")
    provenance = {"bench_toml": bench.text + '[[interlocks]]\nquantity = "gyro_v"\nabove = 4.0\n'}
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running", provenance=provenance))
    step = _begin(writer, 1)
    step.append({**made.streamed(0.0, 100), "gyro_v": np.full(100, 5.0), **made.polled(0.0)})
    step.flush()
    limits = {one["quantity"]: one for one in Follower(writer.folder).look()["limits"]}
    writer.release()
    most_dps = bench.limits.rate_dps
    assert limits["rate_dps"]["margin"] == pytest.approx((most_dps - 50.0) / most_dps)
    assert limits["gyro_v"] == {
        "quantity": "gyro_v", "unit": "V", "low": None, "high": 4.0, "value": 5.0, "margin": -0.25,
    }  # fmt: skip
    assert limits["acceleration_dps2"]["value"] is limits["acceleration_dps2"]["margin"] is None


def test_silence_is_told_and_waiting_for_a_person_is_none(
    writer: CampaignWriter, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_SILENCE_S", 3600.0)
    writer.event("step", bench_s=0.0, index=1, number=1, name="rate +1")
    step = _begin(writer, 1)
    step.append(made.step(1, rows=10).channels)
    step.flush()
    follower = Follower(writer.folder)
    assert not follower.look()["stalled"]
    monkeypatch.setattr(module, "_SILENCE_S", 0.0)
    time.sleep(0.5)
    silent = follower.look()
    assert silent["stalled"]
    assert silent["data_age_s"] >= 0.5
    assert silent["says"].startswith("nothing has come for ")
    writer.event("hold", on=True, says="air_c above 80 (80.4 at first)")
    assert not follower.look()["stalled"]
    time.sleep(0.5)
    held = follower.look()
    assert (held["stalled"], held["doing"]) == (False, "on hold")
    assert held["says"] == "on hold: air_c above 80 (80.4 at first)"


def test_a_stop_that_was_asked_for_is_told(writer: CampaignWriter) -> None:
    follower = Follower(writer.folder)
    assert not follower.look()["stop_asked"]
    (writer.folder / "stop.json").write_text("{}")
    assert follower.look()["stop_asked"]


def test_a_step_whose_file_is_only_being_made_is_waited_for(writer: CampaignWriter) -> None:
    follower = Follower(writer.folder)
    part = writer.folder / "steps" / "0001_rate.h5.part"
    part.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(40))
    found = follower.look([WATCH])
    assert (found["status"], found["samples"]) == ("running", 0)
    part.unlink()
    step = _begin(writer, 1)
    step.append(made.step(1).channels)
    step.flush()
    assert follower.look([WATCH])["samples"] == 200


def test_closed_and_gone_on_with_and_removed(writer: CampaignWriter) -> None:
    follower = Follower(writer.folder)
    step = _begin(writer, 1)
    step.append(made.step(1).channels)
    step.flush()
    follower.look([WATCH])
    writer.step_over(step.close(made.info(1, t_start=100.0, t_end=102.0)))
    writer.finish("complete")
    over = follower.look([WATCH])
    assert (over["status"], over["samples"], over["died"], over["left_s"]) == ("complete", 200, False, None)
    assert len(over["series"][0]["gyro_v"]["t_s"]) == 200
    shutil.rmtree(writer.folder)
    gone = follower.look([WATCH])
    assert (gone["status"], gone["died"], gone["stalled"]) == ("unreadable", False, False)
    assert gone["says"] == "the campaign's folder is gone, or cannot be read"


def test_a_campaign_that_is_gone_on_with_is_followed_again(writer: CampaignWriter) -> None:
    follower = Follower(writer.folder)
    step = _begin(writer, 1)
    step.append(made.step(1).channels)
    writer.step_over(step.close(made.info(1, t_start=100.0, t_end=102.0)))
    follower.look([WATCH])
    writer.finish("interrupted", "stopped by Ctrl-C")
    assert follower.look([WATCH])["status"] == "interrupted"
    lock = campaign_lock(writer.folder)
    lock.acquire("going on")
    again, _ = reopen(writer.folder, 5, lock)
    again.event("resume", bench_s=110.0, whole=1)
    assert follower.look([WATCH])["status"] == "running"
    step = _begin(again, 2)
    step.append({**made.streamed(120.0, 30), **made.polled(120.0)})
    step.flush()
    found = follower.look([WATCH])
    again.release()
    assert (found["status"], found["samples"], found["doing"]) == ("running", 230, "preparing the bench")
    assert len(found["series"][0]["gyro_v"]["t_s"]) == 230
    assert [event["kind"] for event in found["events"]] == []


def test_a_campaign_that_is_over_shows_its_last_stretch(tmp_path: Path) -> None:
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running"))
    step = _begin(writer, 1)
    step.append(made.step(1).channels)
    writer.event("safe", bench_s=102.0, status="complete")
    writer.step_over(step.close(made.info(1, t_start=100.0, t_end=102.0)))
    writer.finish("complete")
    found = Follower(tmp_path / "c").look([WATCH])
    assert (found["status"], len(found["series"][0]["gyro_v"]["t_s"])) == ("complete", 200)


@contextmanager
def _process(*command: str) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen([sys.executable, "-m", *command], stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        try:
            yield process
        finally:
            process.kill()


def test_a_process_that_is_killed_has_died_and_can_be_recovered(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    with _process("tests.benchctl.recordings.writing_process", str(folder), "slowly", "0.02") as process:
        assert process.stdout is not None
        process.stdout.readline()
        follower = Follower(folder)
        assert follower.look()["status"] == "running"
        time.sleep(0.6)
        before = follower.look()
        assert before["samples"] > 0
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        killed_s = time.monotonic()
        while not follower.look([WATCH])["died"]:
            assert time.monotonic() - killed_s < 20.0
            time.sleep(0.05)
    dead = follower.look([WATCH])
    assert (dead["status"], dead["stalled"]) == ("died", False)
    assert dead["samples"] >= before["samples"]
    assert dead["says"].startswith("its program died: benchctl recover ")
    recover(folder)
    assert follower.look([WATCH])["status"] == "aborted"


def test_a_process_that_writes_step_after_step_is_followed_until_all_is_gathered(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    with _process("tests.benchctl.recordings.writing_process", str(folder), "fast", "15") as process:
        while not (folder / "steps").is_dir():
            time.sleep(0.001)
        follower = Follower(folder)
        wide = Watch(("gyro_v",), 5000.0, 4000)
        looks = [follower.look([wide])]
        while looks[-1]["status"] == "running":
            looks.append(follower.look([wide]))
        assert process.wait() == 0
    assert looks[-1]["status"] == "complete"
    # every step was seen, though many began and ended between two looks
    series = looks[-1]["series"][0]["gyro_v"]
    values = np.concatenate([made.streamed(100.0 * index, 200, seed=index)["gyro_v"] for index in range(1, 16)])
    time_s = np.concatenate([made.streamed(100.0 * index, 200)["time_s"] for index in range(1, 16)])
    assert len(series["t_s"]) == 3000
    assert (series["t_s"], series["low"]) == (time_s.tolist(), values.tolist())
    assert not any(look["died"] or look["stalled"] for look in looks)


@pytest.mark.slow
def test_a_campaign_that_is_really_run_is_followed_to_its_end(tmp_path: Path) -> None:
    folder, told = tmp_path / "c", tmp_path / "told.json"
    run = ("benchctl", "run", "rate_sweep", "--bench", "simulated", "-p", "rates=2", "-p", "run_s=5", "-p", "soak_s=60")
    with _process(*run, "--out", str(folder), "--json", str(told), "--quiet") as process:
        while not (folder / "steps").is_dir():
            assert process.poll() is None
            time.sleep(0.005)
        follower = Follower(folder)
        looks = [follower.look([WATCH])]
        while looks[-1]["status"] == "running":
            looks.append(follower.look([WATCH]))
            time.sleep(0.02)
        assert process.wait() == 0
    last, outcome = follower.look([WATCH]), json.loads(told.read_text())
    assert last["status"] == "complete"
    assert last["samples"] == outcome["samples"]
    assert last["step"]["count"] == outcome["steps"]["planned"]
    samples = [look["samples"] for look in looks]
    assert samples == sorted(samples)
    numbers = [event["number"] for look in looks for event in look["events"]]
    assert numbers == sorted(set(numbers))
    assert len({look["doing"] for look in looks}) > 2
    assert {look["values"]["setpoint_c"] for look in looks} > {None}
    assert not any(look["stalled"] or look["died"] for look in looks)
