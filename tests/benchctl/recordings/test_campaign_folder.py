from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import xarray

from benchctl.recordings.campaign_folder import CampaignWriter, campaign_lock
from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import verify
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made

CHANNELS = (*made.STREAMED, *made.POLLED)
OTHER_PROGRAM = """
import sys, h5py, xarray
with xarray.open_dataset(sys.argv[1], engine="h5netcdf", group="steps/0002", driver_kwds={"swmr": True}) as data:
    print(data["gyro_v"].size, data.attrs["whole"])
with h5py.File(sys.argv[1], "r", swmr=True) as file:
    print(*file["steps/0002/gyro_v"].shape)
"""


def _begin(folder: Path) -> CampaignWriter:
    return CampaignWriter(folder, made.meta(status="running"))


def _write_step(writer: CampaignWriter, index: int) -> None:
    whole = made.step(index)
    step = writer.begin_step(whole.info, CHANNELS)
    for rows in (slice(0, 150), slice(150, None)):
        step.append({name: whole[name][rows] for name in made.STREAMED})
    step.append({name: whole[name] for name in made.POLLED})
    step.close(whole.info)


def test_a_finished_campaign_is_one_file_with_all_its_steps(tmp_path: Path) -> None:
    writer = _begin(tmp_path / "c")
    for index in (1, 2, 3):
        _write_step(writer, index)
    path = writer.finish("complete")
    assert sorted(item.name for item in (tmp_path / "c").iterdir()) == ["journal.jsonl", "recording.h5"]
    assert verify(path) == []
    for opened in (path, tmp_path / "c"):
        with open_recording(opened) as recording:
            assert recording.meta.status == "complete"
            for read, written in zip(recording.steps(), made.steps(3), strict=True):
                assert made.same(read, written)
    with xarray.open_dataset(path, engine="h5netcdf", group="steps/0003") as data:
        assert data["gyro_v"].dims == ("time_s",)
        assert data["poll_chamber_temp_c"].dims == ("poll_time_s",)


def test_the_campaign_and_the_one_go_writer_make_the_same_steps(tmp_path: Path) -> None:
    writer = _begin(tmp_path / "c")
    for index in (1, 2, 3):
        _write_step(writer, index)
    with open_recording(writer.finish("complete")) as one, open_recording(made.recording(tmp_path)) as other:
        assert one.infos == other.infos


def test_a_running_campaign_can_be_read_up_to_the_last_flush(tmp_path: Path) -> None:
    writer = _begin(tmp_path / "c")
    _write_step(writer, 1)
    step = writer.begin_step(made.info(2, t_start=200.0), CHANNELS)
    step.append(made.streamed(200.0, 80))
    step.flush()
    step.append(made.streamed(200.8, 10))
    with open_recording(tmp_path / "c") as recording:
        first, second = recording.infos
        assert recording.meta.status == "running"
        assert first.whole
        assert (second.whole, second.digest) == (False, "")
        assert second.samples in (80, 90)  # 0.2 s after the last ones came, as on a busy machine, they are flushed too
        assert second.t_end == pytest.approx(200.0 + (second.samples - 1) * 0.01)
        assert made.same(recording.step(1), made.step(1))
        assert recording.step(2)["gyro_v"].size == second.samples
        assert np.array_equal(recording.step(2)["gyro_v"][:80], made.streamed(200.0, 80)["gyro_v"])
    assert [str(problem) for problem in verify(tmp_path / "c")] == [
        "0002_rate_+2.h5.part: was not finished: it is being written, or its program died"
    ]
    writer.release()


def test_a_step_that_finishes_while_it_is_being_looked_at_is_read_as_it_was_when_it_was_opened(tmp_path: Path) -> None:
    writer = _begin(tmp_path / "c")
    step = writer.begin_step(made.info(1), CHANNELS)
    step.append({**made.streamed(0.0, 10), **made.polled(0.0)})
    step.flush()
    with open_recording(tmp_path / "c") as recording:
        step.append(made.streamed(0.1, 10))
        step.close(made.info(1))
        assert recording.step(1)["gyro_v"].size == recording.infos[0].samples == 10
    with open_recording(tmp_path / "c") as recording:
        assert recording.step(1)["gyro_v"].size == 20


def test_xarray_and_h5py_read_a_running_campaign_without_this_package(tmp_path: Path) -> None:
    writer = _begin(tmp_path / "c")
    _write_step(writer, 1)
    step = writer.begin_step(made.info(2), CHANNELS)
    step.append(made.streamed(0.0, 80))
    step.flush()
    finished, running = sorted((tmp_path / "c" / "steps").iterdir())
    with xarray.open_dataset(finished, engine="h5netcdf", group="steps/0001") as data:
        assert data["gyro_v"].size == 200
    read = subprocess.run(
        [sys.executable, "-c", OTHER_PROGRAM, str(running)], capture_output=True, text=True, check=False
    )
    assert (read.stdout, read.stderr) == ("80 0\n80\n", "")
    writer.release()


def test_an_interrupted_campaign_says_so_and_marks_the_cut_step(tmp_path: Path) -> None:
    writer = _begin(tmp_path / "c")
    _write_step(writer, 1)
    step = writer.begin_step(made.info(2, t_start=200.0, t_end=900.0), CHANNELS)
    step.append(made.streamed(200.0, 30))
    with open_recording(writer.finish("interrupted", "Ctrl-C")) as recording:
        assert recording.meta.status == "interrupted"
        assert recording.meta.provenance["reason"] == "Ctrl-C"
        assert [info.whole for info in recording.infos] == [True, False]
        assert recording.infos[1].t_end == pytest.approx(200.29)
        assert recording.infos[1].samples == 30


def test_a_step_that_is_cut_keeps_what_is_told_of_it(tmp_path: Path) -> None:
    writer = _begin(tmp_path / "c")
    step = writer.begin_step(made.info(1), CHANNELS)
    step.append(made.streamed(0.0, 30))
    told = step.cut(replace(made.info(1), t_end=0.3, gaps=2))
    assert (told.whole, told.t_end, told.gaps, told.samples) == (False, 0.3, 2, 30)


def test_the_journal_is_kept_beside_and_inside_the_recording(tmp_path: Path) -> None:
    writer = _begin(tmp_path / "c")
    writer.event("decision", bench_time_s=12.5, says="soaked: 20 °C ± 0.1")
    path = writer.finish("complete", "done")
    lines = [json.loads(line) for line in (tmp_path / "c" / "journal.jsonl").read_text().splitlines()]
    assert [line["kind"] for line in lines] == ["decision", "finish"]
    assert lines[0]["says"] == "soaked: 20 °C ± 0.1"
    with open_recording(path) as recording:
        kept = recording.meta.provenance["journal"]
    assert [json.loads(line) for line in kept.splitlines()] == lines


@pytest.mark.skipif(sys.platform != "linux", reason="looks at open files as Linux names them")
def test_once_a_step_is_over_its_file_and_the_line_that_says_so_are_on_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "c"
    writer = _begin(folder)
    synced: list[tuple[str, str]] = []
    fsync = os.fsync

    def noted(descriptor: int) -> None:
        path = os.readlink(f"/proc/self/fd/{descriptor}")
        last = Path(path).read_text().rpartition("\n")[0].rpartition("\n")[2] if path.endswith(".jsonl") else ""
        synced.append((Path(path).name, str(json.loads(last)["kind"]) if last else ""))
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", noted)
    step = writer.begin_step(made.info(1), CHANNELS)
    step.append({**made.streamed(0.0, 10), **made.polled(0.0)})
    writer.step_over(step.close(made.info(1)))
    (file, _), (its_folder, _), journal = synced
    assert file.startswith(".0001_rate_+1.h5.")
    assert (its_folder, journal) == ("steps", ("journal.jsonl", "whole"))
    writer.release()


def test_two_programs_cannot_write_one_campaign(tmp_path: Path) -> None:
    writer = _begin(tmp_path / "c")
    lock = campaign_lock(tmp_path / "c")
    with pytest.raises(UsageError, match=r"campaign .*/c is in use by process \d+ \(recording, since"):
        lock.acquire("another")
    writer.release()
    lock.acquire("another")
    lock.release()


def test_a_campaign_without_a_step_opens(tmp_path: Path) -> None:
    writer = _begin(tmp_path / "c")
    with open_recording(tmp_path / "c") as recording:
        assert recording.infos == ()
    with open_recording(writer.finish("aborted", "the chamber did not answer")) as recording:
        assert (recording.infos, recording.meta.status) == ((), "aborted")


def test_a_folder_that_holds_something_is_not_written_to(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match="already and not empty; name another folder"):
        _begin(tmp_path)
    assert [item.name for item in tmp_path.iterdir()] == ["notes.txt"]


def test_one_step_at_a_time_and_each_index_once(tmp_path: Path) -> None:
    writer = _begin(tmp_path / "c")
    step = writer.begin_step(made.info(1), CHANNELS)
    with pytest.raises(UsageError, match="step 1 is still open"):
        writer.begin_step(made.info(2), CHANNELS)
    step.close(made.info(1))
    with pytest.raises(UsageError, match="step 1 is already there"):
        writer.begin_step(made.info(1, name="again"), CHANNELS)
    with pytest.raises(UsageError, match="cannot be finished"):
        step.close(made.info(1))


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"time_s": np.arange(3.0)}, "expected all of"),
        ({**made.streamed(0.0, 3), "extra_v": np.ones(3)}, "expected all of"),
        (
            {**made.streamed(0.0, 3), "gyro_v": np.ones(2)},
            "gyro_v has 2 samples, expected as many as its axis time_s, 3",
        ),
        ({"gyro_v": np.ones(2)}, "is not among the channels"),
    ],
)
def test_samples_that_do_not_fit_are_refused_and_not_written(
    tmp_path: Path, given: dict[str, np.ndarray], says: str
) -> None:
    writer = _begin(tmp_path / "c")
    step = writer.begin_step(made.info(1), CHANNELS)
    with pytest.raises(UsageError, match=says):
        step.append(given)
    assert step.close(made.info(1)).samples == 0


def test_samples_may_be_changed_by_their_owner_after_they_were_appended(tmp_path: Path) -> None:
    writer = _begin(tmp_path / "c")
    step = writer.begin_step(made.info(1), CHANNELS)
    block = made.streamed(0.0, 5)
    step.append(block)
    block["gyro_v"][:] = 0.0
    step.close(made.info(1))
    with open_recording(writer.finish("complete")) as recording:
        assert np.array_equal(recording.step(1)["gyro_v"], made.streamed(0.0, 5)["gyro_v"])


def test_a_step_that_changed_on_the_disk_is_not_gathered_and_the_steps_stay(tmp_path: Path) -> None:
    writer = _begin(tmp_path / "c")
    _write_step(writer, 1)
    (file,) = (tmp_path / "c" / "steps").iterdir()
    with h5py.File(file, "r+") as opened:
        opened["steps/0001/gyro_v"][3] += 1e-9
    with pytest.raises(UsageError, match="channel gyro_v: samples changed"):
        writer.finish("complete")
    assert not (tmp_path / "c" / "recording.h5").exists()
    file.write_bytes(file.read_bytes()[:4000])
    with pytest.raises(UsageError, match=r"0001_rate_\+1\.h5: was cut short"):
        writer.finish("complete")
    assert file.exists()


def test_a_disk_that_fills_is_never_written_to_and_the_campaign_stays_readable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = _begin(tmp_path / "c")
    step = writer.begin_step(made.info(1), CHANNELS)
    step.append(made.streamed(0.0, 50))
    step.flush()
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=33_000_000))
    step.append(made.streamed(0.5, 50))
    with pytest.raises(UsageError, match="the disk has 33 MB left, 34 MB are needed; make room"):
        step.flush()
    with pytest.raises(UsageError, match="make room"):
        writer.finish("aborted", "the disk is full")
    writer.release()
    with open_recording(tmp_path / "c") as recording:
        assert recording.step(1)["gyro_v"].size == 50
        assert "the disk is full" in recording.meta.provenance["journal"]
