"""A digital gyro's frames in recordings: an axis of their own, from the file that is being written to every export."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import loadmat

from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.exporting import export_csv, export_mat, export_open
from benchctl.recordings.model import DESCRIPTIONS, FRAME_CHANNELS, UNITS, Step, axis_of
from benchctl.recordings.reader import APART_S, join, open_recording
from benchctl.recordings.recover import recover
from benchctl.recordings.verify import summarise, verify
from benchctl.recordings.writer import write_recording
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings.made import POLLED, STREAMED, info, meta, polled, streamed

FRAME_RATE_HZ = 250.0


def frames(t_start: float, rows: int) -> dict[str, FloatArray]:
    return {
        "frame_time_s": t_start + 0.001 + np.arange(rows) / FRAME_RATE_HZ,
        "frame_rate_dps": np.linspace(-3.0, 3.0, rows),
        "frame_temp_c": np.full(rows, 21.5),
        "frame_status": np.zeros(rows),
    }


def step(index: int, lost: int = 0) -> Step:
    described = info(
        index,
        t_start=10.0 * index,
        t_end=10.0 * index + 2.0,
        frame_rate_hz=FRAME_RATE_HZ,
        frames_lost=lost,
        frames_bad=0,
    )
    chamber = {**polled(10.0 * index), "poll_chamber_setpoint_c": np.full(3, 20.0)}
    air = {"chamber_temp_c": np.full(200, 20.0)}
    return Step(described, {**streamed(10.0 * index, 200), **air, **chamber, **frames(10.0 * index, 500)})


def test_frames_lie_on_their_own_axis_and_other_channels_that_begin_so_do_not() -> None:
    assert {axis_of(name) for name in FRAME_CHANNELS} == {"frame_time_s"}
    assert axis_of("frame_of_the_table_c") == "time_s"
    assert set(FRAME_CHANNELS) <= set(UNITS) & set(DESCRIPTIONS)


def test_a_recording_gives_frames_back_with_their_axis_their_units_and_what_was_lost(tmp_path: Path) -> None:
    path = tmp_path / "r.h5"
    write_recording(path, meta(), [step(1, lost=3)])
    with h5py.File(path) as file:
        rate = file["steps/0001/frame_rate_dps"]
        assert rate.attrs["units"] == "degree/s"
        assert rate.dims[0][0].name == "/steps/0001/frame_time_s"
    with open_recording(path) as recording:
        back = recording.step(1)
        assert (back.info.frame_rate_hz, back.info.frames_lost, back.info.frames_bad) == (FRAME_RATE_HZ, 3, 0)
        assert back.info.samples == 200
        np.testing.assert_array_equal(back["frame_rate_dps"], step(1)["frame_rate_dps"])
        told = summarise(recording)
    rates_hz = {channel["name"]: channel["rate_hz"] for channel in told["channels"]}
    assert (rates_hz["gyro_v"], rates_hz["frame_rate_dps"], rates_hz["poll_time_s"]) == (100.0, FRAME_RATE_HZ, None)
    assert told["steps"][0]["frames_lost"] == 3
    assert verify(path) == []


def test_a_step_without_a_digital_gyro_says_nothing_of_frames(tmp_path: Path) -> None:
    path = tmp_path / "r.h5"
    write_recording(path, meta(), [Step(info(1), {**streamed(0.0, 200), **polled(0.0)})])
    with h5py.File(path) as file:
        assert not [name for name in file["steps/0001"].attrs if name.startswith("frame")]
    with open_recording(path) as recording:
        assert not [key for key in summarise(recording)["steps"][0] if key.startswith("frame")]
        export_csv(recording, tmp_path / "csv")
    assert "frame" not in (tmp_path / "csv" / "recording.json").read_text(encoding="utf-8")


def test_frames_that_do_not_fit_together_are_refused(tmp_path: Path) -> None:
    short = {**streamed(0.0, 200), **frames(0.0, 500), "frame_status": np.zeros(499)}
    with pytest.raises(
        UsageError, match="frame_status has 499 samples, expected as many as its axis frame_time_s, 500"
    ):
        write_recording(tmp_path / "r.h5", meta(), [Step(info(1), short)])
    without = {name: samples for name, samples in step(1).channels.items() if name != "frame_time_s"}
    with pytest.raises(UsageError, match="lies on frame_time_s, which is not among the channels"):
        write_recording(tmp_path / "r.h5", meta(), [Step(info(1), without)])


def test_exports_have_the_frames_beside_the_scans(tmp_path: Path) -> None:
    path = tmp_path / "r.h5"
    write_recording(path, meta(), [step(1, lost=2)])
    with open_recording(path) as recording:
        export_csv(recording, tmp_path / "csv")
        export_mat(recording, tmp_path / "r.mat")
        export_open(recording, tmp_path / "open")
    told = json.loads((tmp_path / "csv" / "recording.json").read_text(encoding="utf-8"))["steps"][0]
    assert told["frames_lost"] == 2
    (name,) = [name for name in told["files"] if name.endswith("_frames.csv")]
    lines = (tmp_path / "csv" / name).read_text(encoding="utf-8").splitlines()
    assert (lines[0], len(lines)) == (",".join(FRAME_CHANNELS), 501)
    assert not [name for name in told["files"] if name.endswith("1.csv") and "frame" in name]
    struct = loadmat(tmp_path / "r.mat")["step_0001"][0, 0]
    assert struct["frame_rate_dps"].shape == (500, 1)
    with open_recording(tmp_path / "open") as opened:
        assert not set(opened.channels(1)) & set(FRAME_CHANNELS)  # an open recording has one clock, that of the scans
        assert opened.infos[0].samples == 200


def test_recordings_that_are_read_as_one_move_their_frames_with_the_rest(tmp_path: Path) -> None:
    paths = [tmp_path / "a.h5", tmp_path / "b.h5"]
    for path in paths:
        write_recording(path, meta(), [step(1)])
    with open_recording(paths[0]) as first, open_recording(paths[1]) as second:
        moved = join([first, second]).step(2)
    np.testing.assert_allclose(moved["frame_time_s"] - moved["time_s"][0], step(1)["frame_time_s"] - 10.0, atol=1e-9)
    assert moved["frame_time_s"][0] > APART_S
    np.testing.assert_array_equal(moved["frame_rate_dps"], step(1)["frame_rate_dps"])


def test_frames_are_read_while_they_are_written_and_a_crash_leaves_them_and_their_gaps(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    writer = CampaignWriter(folder, meta(status="running"))
    begun = replace(step(1).info, whole=False, t_end=10.0, frames_lost=None, frames_bad=None)
    into = writer.begin_step(begun, (*STREAMED, *POLLED, *FRAME_CHANNELS))
    into.append({**streamed(10.0, 150), **polled(10.0, 2)})
    whole = frames(10.0, 500)
    into.append({name: np.delete(samples, [7, 8, 300]) for name, samples in whole.items()})
    into.flush()
    with open_recording(folder) as running:
        assert running.step(1)["frame_time_s"].size == 497
        assert running.infos[0].t_end == pytest.approx(whole["frame_time_s"][-1])
    into.release()
    writer.release()
    recover(folder)
    with open_recording(folder) as recording:
        (cut,) = recording.infos
        assert (cut.whole, cut.samples, cut.frames_lost) == (False, 150, 3)
        assert recording.step(1)["frame_rate_dps"].size == 497
