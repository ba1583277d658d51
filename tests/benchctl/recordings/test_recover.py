"""Recovering what a killed process left, and killing what recovers."""

from __future__ import annotations

import random
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest

from benchctl.recordings.campaign_folder import CampaignWriter, campaign_lock
from benchctl.recordings.reader import open_recording
from benchctl.recordings.recover import recover, reopen
from benchctl.recordings.verify import verify
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made

ROOT = Path(__file__).resolve().parents[3]
PLANNED = 12
SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 20))]


@contextmanager
def _process(module: str, folder: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", f"tests.benchctl.recordings.{module}", str(folder), *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        try:
            yield process
        finally:
            process.kill()


def _killed_campaign(folder: Path, delay_s: float) -> set[int]:
    """Let a process write a campaign and kill it; the indices whose closing it had told."""
    with _process("writing_process", folder, "fast", str(PLANNED)) as process:
        assert process.stdout is not None
        told = [process.stdout.readline()]
        time.sleep(delay_s)
        process.kill()
        told += process.stdout.readlines()
    return {int(line) for line in told if line.strip() not in ("finished", "")}


def _kill_while(folder: Path, how: str, delay_s: float) -> bool:
    """Let a process recover or reopen a campaign and kill it; whether it was faster."""
    with _process("closing_process", folder, how) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begins\n"
        time.sleep(delay_s)
        process.kill()
        return process.stdout.readline() == "done\n"


@pytest.mark.parametrize("seed", SEEDS)
def test_killed_at_any_moment_a_campaign_is_recovered_with_every_step_that_was_told_to_be_whole(
    tmp_path: Path, seed: int
) -> None:
    chance, folder = random.Random(seed), tmp_path / "c"
    told = _killed_campaign(folder, chance.uniform(0.0, 0.4))
    for _ in range(2):
        _kill_while(folder, "recover", chance.uniform(0.0, 0.05))
    closed = recover(folder)
    assert verify(folder) == []
    assert told <= {info.index for info in closed.steps if info.whole}
    with open_recording(folder) as recording:
        assert recording.meta.status == closed.status
        assert all(made.same(recording.step(index), made.step(index)) for index in told)
        assert closed.status == (
            "complete" if '"kind": "finish"' in recording.meta.provenance["journal"] else "aborted"
        )
    before = closed.recording.read_bytes()
    again = recover(folder)
    assert again.was_closed
    assert (again.steps, again.status) == (closed.steps, closed.status)
    assert closed.recording.read_bytes() == before
    assert sorted(item.name for item in folder.iterdir()) == ["journal.jsonl", "manifest.json", "recording.h5"]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_recording_that_is_taken_apart_loses_nothing_where_that_is_killed(tmp_path: Path, seed: int) -> None:
    chance, folder = random.Random(seed), tmp_path / "c"
    told = _killed_campaign(folder, 0.2)
    recover(folder)
    for _ in range(2):
        _kill_while(folder, "reopen", chance.uniform(0.0, 0.12))
        with open_recording(folder) as recording:
            assert all(made.same(recording.step(index), made.step(index)) for index in told)
    closed = recover(folder)
    assert told <= {info.index for info in closed.steps if info.whole}
    assert verify(folder) == []


def _begun(folder: Path) -> CampaignWriter:
    """A campaign with one whole step and one that is being written; its program is gone once `release` was called."""
    writer = CampaignWriter(folder, made.meta(status="running"))
    first = writer.begin_step(made.info(1), made.STREAMED)
    first.append(made.streamed(0.0, 100))
    first.close(made.info(1))
    second = writer.begin_step(made.info(2, t_start=10.0, role="verify"), made.STREAMED)
    second.append(made.streamed(10.0, 50))
    second.append(made.streamed(12.0, 50))
    second.flush()
    return writer


def test_the_step_that_was_being_written_becomes_a_cut_one_with_its_gaps(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    _begun(folder).release()
    with open_recording(folder) as recording:
        part = recording.step(2)
    closed = recover(folder)
    assert (closed.status, closed.complete) == ("aborted", 1)
    assert closed.reason.startswith("its program died")
    cut = closed.steps[1]
    assert (cut.whole, cut.samples, cut.gaps, cut.role) == (False, 100, 1, "verify")
    assert cut.t_end == pytest.approx(12.49)
    with open_recording(folder) as recording:
        assert made.same(recording.step(2), part)
        assert recording.meta.provenance["reason"] == closed.reason


@pytest.mark.parametrize("rate_hz", [made.RATE_HZ, 1.0001 * made.RATE_HZ])
def test_a_cut_step_has_the_rate_of_its_stamps_whatever_was_asked_for(tmp_path: Path, rate_hz: float) -> None:
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running"))
    step = writer.begin_step(made.info(1), made.STREAMED)
    for first_s in (1000.0, 1002.0):
        step.append({**made.streamed(0.0, 50), "time_s": first_s + np.arange(50) / rate_hz})
    step.flush()
    writer.release()
    (cut,) = recover(tmp_path / "c").steps
    assert (cut.sample_rate_hz, cut.gaps) == (pytest.approx(rate_hz, rel=1e-9), 1)
    if rate_hz == made.RATE_HZ:
        assert cut.sample_rate_hz == rate_hz


def test_a_campaign_that_is_being_written_is_not_touched(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    writer = _begun(folder)
    before = sorted(folder.rglob("*"))
    with pytest.raises(UsageError, match=r"campaign .*/c is in use by process \d+ \(recording, since "):
        recover(folder)
    assert sorted(folder.rglob("*")) == before
    writer.release()


@pytest.mark.slow
def test_files_of_steps_that_cannot_be_read_are_put_aside_and_said_and_the_rest_is_recovered(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    _begun(folder).release()
    finished, part = sorted((folder / "steps").iterdir())
    part.write_bytes(part.read_bytes()[:100])
    with h5py.File(finished, "r+") as file:
        file["steps/0001/gyro_v"][3] += 1e-9
    shutil.copy(finished, folder / "steps" / "0003_as_it_was.h5")
    shutil.copyfile(made.recording(tmp_path, 1), folder / "steps" / "0004_good.h5")
    closed = recover(folder)
    assert [file.name for file in closed.unreadable] == ["0001_rate_+1.h5", "0002_rate_+2.h5.part", "0003_as_it_was.h5"]
    assert [info.index for info in closed.steps] == [1]
    journal = (folder / "journal.jsonl").read_text(encoding="utf-8")
    assert "channel gyro_v: samples changed since it was written" in journal


def test_what_a_death_left_of_a_lock_is_removed_and_no_changed_file_becomes_good_by_it(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    _begun(folder).release()
    recover(folder)
    (folder / "journal.jsonl").write_text("not what it was\n")
    for name in ("running.lock", "running.json"):
        (folder / name).touch()
    assert recover(folder).was_closed
    assert sorted(item.name for item in folder.iterdir()) == ["journal.jsonl", "manifest.json", "recording.h5"]
    assert any("journal.jsonl" in str(problem) for problem in verify(folder))


@pytest.mark.parametrize("written", [False, True])
def test_half_of_a_manifest_that_a_death_left_is_removed(tmp_path: Path, written: bool) -> None:
    folder = tmp_path / "c"
    _begun(folder).release()
    recover(folder)
    if written:
        (folder / "running.lock").touch()
    else:
        (folder / "manifest.json").unlink()
    (folder / ".manifest.json.28085.tmp").write_text('{"schema":')
    assert recover(folder).was_closed
    assert sorted(item.name for item in folder.iterdir()) == ["journal.jsonl", "manifest.json", "recording.h5"]
    assert verify(folder) == []


def _gathered_beside_its_steps(folder: Path) -> bytes:
    """A campaign that was closed, with the files of its two steps put back beside the recording; returns that."""
    _begun(folder).release()
    lock = campaign_lock(folder)
    lock.acquire("a test")
    reopen(folder, 2, lock)[0].release()
    shutil.copytree(folder / "steps", folder.parent / "steps")
    whole = recover(folder).recording.read_bytes()
    shutil.copytree(folder.parent / "steps", folder / "steps")
    return whole


def _recovered_or_reopened(folder: Path, how: str) -> None:
    if how == "recover":
        recover(folder)
        return
    lock = campaign_lock(folder)
    lock.acquire("a test")
    try:
        reopen(folder, 2, lock)[0].release()
    finally:
        lock.release()


def _flipped(content: bytes) -> bytes:
    """The bytes with one of a chunk of samples changed, which only its digest tells."""
    place = len(content) // 2
    return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]


DAMAGE: dict[str, Callable[[bytes], bytes]] = {
    "a bit": _flipped,
    "cut short": lambda content: content[:5000],
    "empty": lambda content: b"",
    "zeroed": lambda content: bytes(len(content)),
}


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("how", ["recover", "reopen"])
def test_a_damaged_recording_beside_sound_steps_is_kept_and_the_steps_are_gathered_again(
    tmp_path: Path, how: str, damage: str
) -> None:
    folder = tmp_path / "c"
    content = DAMAGE[damage](_gathered_beside_its_steps(folder))
    (folder / "recording.h5").write_bytes(content)
    _recovered_or_reopened(folder, how)
    closed = recover(folder)
    assert closed.was_closed == (how == "recover")
    assert [info.index for info in closed.steps] == [1, 3]
    assert (folder / "unreadable" / "recording.h5").read_bytes() == content
    assert verify(folder) == []
    with open_recording(folder) as recording:
        assert np.array_equal(recording.step(1)["gyro_v"], made.streamed(0.0, 100)["gyro_v"])


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("how", ["recover", "reopen"])
def test_a_damaged_recording_without_steps_is_refused_and_nothing_is_removed(
    tmp_path: Path, how: str, damage: str
) -> None:
    folder = tmp_path / "c"
    content = DAMAGE[damage](_gathered_beside_its_steps(folder))
    (folder / "recording.h5").write_bytes(content)
    for file in (folder / "steps").iterdir():
        file.write_bytes(b"")
    before = sorted(folder.rglob("*"))
    with pytest.raises(UsageError, match="no steps to gather again"):
        _recovered_or_reopened(folder, how)
    assert sorted(folder.rglob("*")) == before
    assert (folder / "recording.h5").read_bytes() == content


@pytest.mark.parametrize("how", ["recover", "reopen"])
def test_a_step_that_a_sound_recording_lacks_is_not_removed(tmp_path: Path, how: str) -> None:
    folder = tmp_path / "c"
    _gathered_beside_its_steps(folder)
    shutil.copyfile(made.recording(tmp_path, 1), folder / "steps" / "0001_another.h5")
    before = sorted(folder.rglob("*"))
    with pytest.raises(UsageError, match=r"0001_another\.h5: is not in .*recording\.h5"):
        _recovered_or_reopened(folder, how)
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize("how", ["zeroed", "absent"])
def test_a_campaign_whose_description_is_lost_is_described_by_its_steps(tmp_path: Path, how: str) -> None:
    folder = tmp_path / "c"
    _begun(folder).release()
    (folder / "campaign.h5").unlink()
    if how == "zeroed":
        (folder / "campaign.h5").write_bytes(bytes(17408))
    closed = recover(folder)
    assert [(info.index, info.whole, info.samples) for info in closed.steps] == [(1, True, 100), (2, False, 100)]
    with open_recording(folder) as recording:
        assert recording.meta.unit == made.meta().unit
        assert recording.meta.provenance["operator"] == "Ö. Ångström"
    assert verify(folder) == []


@pytest.mark.parametrize("length", [0, 11, 48, 600])
def test_a_step_whose_file_had_only_begun_held_no_sample_and_leaves_nothing(tmp_path: Path, length: int) -> None:
    folder = tmp_path / "c"
    _begun(folder).release()
    with h5py.File(tmp_path / "new.h5", "w", libver=("v110", "v110")) as file:
        file.create_group("steps").attrs["text"] = "long" * 500
        file.flush()
        begun = (tmp_path / "new.h5").read_bytes()[:length]
    (folder / "steps" / "0003_begun.h5.part").write_bytes(begun)
    closed = recover(folder)
    assert [info.index for info in closed.steps] == [1, 2]
    assert closed.unreadable == ()
    assert sorted(item.name for item in folder.iterdir()) == ["journal.jsonl", "manifest.json", "recording.h5"]


@pytest.mark.parametrize("how", ["before the folder was described", "no campaign at all"])
def test_a_folder_that_holds_no_campaign_is_refused_in_one_line(tmp_path: Path, how: str) -> None:
    folder = tmp_path / "c"
    folder.mkdir()
    if how == "before the folder was described":
        (folder / "steps").mkdir()
    with pytest.raises(UsageError, match="remove the folder" if "described" in how else "is no campaign: expected"):
        recover(folder)


def test_a_cut_step_gives_its_index_free_and_is_kept_behind_the_plan(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    _begun(folder).release()
    for _ in range(2):
        lock = campaign_lock(folder)
        lock.acquire("a test")
        writer, infos = reopen(folder, 5, lock)
        writer.release()
        assert [(info.index, info.name, info.role, info.whole) for info in infos] == [
            (1, "rate +1", "fit", True),
            (6, "cut attempt of step 2: rate +2", "none", False),
        ]
    with open_recording(folder) as recording:
        assert np.array_equal(recording.step(6)["gyro_v"][:50], made.streamed(10.0, 50)["gyro_v"])
