"""A step that stays in its file: read in parts it is the step that is read whole."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import h5py
import numpy as np
import pytest

from benchctl.recordings import hdf5_files, stored
from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.model import Step
from benchctl.recordings.reader import join, open_recording
from benchctl.recordings.stored import StoredStep, stored_of
from benchctl.recordings.writer import write_recording
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(stored, "SCANS_AT_ONCE", 64)
    return 64


def _glued(parts: Iterable[Step]) -> dict[str, FloatArray]:
    found = list(parts)
    return {name: np.concatenate([part[name] for part in found]) for name in found[0].channels}


@pytest.mark.parametrize("rows", [1, 63, 64, 79, 80, 81, 128, 200])
@pytest.mark.parametrize("in_memory", [True, False])
def test_the_parts_of_a_step_are_the_step(tmp_path: Path, small_parts: int, rows: int, in_memory: bool) -> None:
    whole = made.step(1, rows)
    path = tmp_path / "a.h5"
    write_recording(path, made.meta(), [whole])
    with open_recording(path) as recording:
        step = stored_of(whole) if in_memory else recording.stored_step(1)
        assert step.scans == rows
        assert set(step.names) == set(whole.channels)
        parts = list(step.parts(["time_s", "gyro_v", "poll_time_s", "absent"]))
    assert all(part["time_s"].size <= 1.25 * small_parts for part in parts)
    found = _glued(parts)
    assert list(found) == ["time_s", "gyro_v"]
    assert all(np.array_equal(found[name], whole[name]) for name in found)


def test_an_unfinished_campaign_opens_each_file_of_a_step_once(
    tmp_path: Path, small_parts: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running"))
    for index in (1, 2, 3):
        step = writer.begin_step(made.info(index), made.STREAMED)
        step.append(made.streamed(0.0, 500))
        if index < 3:
            step.close(made.info(index))
    step.flush()
    writer.release()
    opened: list[str] = []
    open_ours = hdf5_files.open_ours
    monkeypatch.setattr(hdf5_files, "open_ours", lambda path: (opened.append(path.name), open_ours(path))[1])
    with open_recording(tmp_path / "c") as recording:
        steps = list(recording.steps())
        for step in steps:
            assert set(recording.channels(step.info.index)) == set(made.STREAMED)
            found = _glued(recording.stored_step(step.info.index).parts())
            assert all(np.array_equal(found[name], step[name]) for name in made.STREAMED)
    assert [name for name in opened if name != "campaign.h5"] == [
        "0001_rate_+1.h5",
        "0002_rate_+2.h5",
        "0003_rate_+3.h5.part",
    ]


def test_parts_are_read_in_order_and_only_one_ahead(small_parts: int) -> None:
    whole = made.step(1, 640)
    begun: list[tuple[str, int]] = []

    def fill(name: str, start: int, samples: FloatArray) -> None:
        begun.append((name, start))
        samples[:] = whole[name][start : start + samples.size]

    step = StoredStep(whole.info, tuple(whole.channels), 640, fill)
    for number, _ in enumerate(step.parts(["time_s", "gyro_v"]), 1):
        assert len(begun) <= 2 * (number + 1)
    for channel in ("time_s", "gyro_v"):
        assert [start for name, start in begun if name == channel] == list(range(0, 640, small_parts))


def test_a_cut_step_and_a_joined_one_are_where_they_say(tmp_path: Path, small_parts: int) -> None:
    whole = made.step(1, 200)
    cut = stored_of(whole).cut(whole.info, 50, 170)
    assert cut.scans == 120
    assert np.array_equal(_glued(cut.parts())["gyro_v"], whole["gyro_v"][50:170])
    path = made.recording(tmp_path, 2)
    with open_recording(path) as one, open_recording(path) as other:
        joined = join([one, other])
        assert [step.info.index for step in joined.stored_steps()] == [1, 2, 3, 4]
        for step in joined.stored_steps():
            loaded, parts = joined.step(step.info.index), _glued(step.parts())
            assert all(np.array_equal(parts[name], loaded[name]) for name in parts)


def test_a_step_that_is_being_written_has_as_many_scans_as_all_its_channels(tmp_path: Path) -> None:
    writer = CampaignWriter(tmp_path / "campaign", made.meta(status="running"))
    step = writer.begin_step(made.info(1), made.STREAMED)
    step.append(made.streamed(0.0, 150))
    step.flush()
    with open_recording(tmp_path / "campaign") as recording:
        [found] = recording.stored_steps()
        assert found.scans == 150
        assert np.array_equal(found.part(20, 150)["gyro_v"], made.streamed(0.0, 150)["gyro_v"][20:])
    writer.release()


def test_a_damaged_channel_is_named_when_its_samples_are_read(tmp_path: Path) -> None:
    path = made.recording(tmp_path)
    with h5py.File(path, "r+") as file:
        file["steps/0002/gyro_v"].id.write_direct_chunk((0,), b"no deflate")
    with open_recording(path) as recording:
        step = recording.stored_step(2)
        assert np.array_equal(step.part(0, 200, ["encoder_deg"])["encoder_deg"], made.step(2)["encoder_deg"])
        with pytest.raises(UsageError, match=r"step 2 .* cannot be read: channel gyro_v: .*benchctl verify"):
            step.part(0, 200)
        with pytest.raises(UsageError, match="there is no step 8"):
            recording.stored_step(8)


def test_a_long_step_is_loaded_in_several_threads_and_is_the_same(tmp_path: Path, small_parts: int) -> None:
    with open_recording(made.recording(tmp_path)) as recording:
        assert made.same(recording.step(2), made.step(2))
