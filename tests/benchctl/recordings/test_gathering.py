"""Gathering beforehand, in a process that is really killed, stopped, and left alone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import pytest

from benchctl.recordings import gathering
from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.combine import Begun, add, begin, combine
from benchctl.recordings.gather import finished_steps, gather
from benchctl.recordings.gathering import MANY, Gathering
from benchctl.recordings.reader import open_recording
from benchctl.recordings.recover import recover
from benchctl.recordings.verify import verify
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made
from tests.waiting import wait_until

ROOT = Path(__file__).resolve().parents[3]
COUNT = MANY + 8
PATIENCE_S = 30.0


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[CampaignWriter]:
    """A campaign with so many steps that they are gathered beforehand."""
    begun = CampaignWriter(tmp_path / "c", made.meta(status="running"))
    _write(begun, range(1, COUNT + 1))
    yield begun
    begun.release()


def _write(writer: CampaignWriter, indices: range, *, told: bool = True) -> None:
    """Write steps; where they are not told to be over nothing is gathered beforehand."""
    for index in indices:
        whole = made.step(index)
        step = writer.begin_step(whole.info, (*made.STREAMED, *made.POLLED))
        step.append(whole.channels)
        info = step.close(whole.info)
        if told:
            writer.step_over(info)


def _left(folder: Path) -> list[Path]:
    return list(folder.glob(".*"))


def _all_gathered(folder: Path) -> bool:
    """Whether what is gathered so far has ceased to grow, long before which the last step is in it."""
    if not (left := _left(folder)):
        return False
    before = left[0].stat()
    time.sleep(1.0)
    after = left[0].stat()
    return after.st_size > 100_000 and (after.st_size, after.st_mtime_ns) == (before.st_size, before.st_mtime_ns)


def _gatherer(folder: Path) -> int:
    """The process that gathers in this folder."""
    told = f"\0benchctl.recordings.gathering\0{folder.absolute()}\0".encode()

    def found() -> list[int]:
        numbers = [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdecimal()]
        # what it asks of the system, such as its processor's name, has its own command for the moment before it begins
        return [number for number in numbers if told in _command(number) and _leads_a_session(number)]

    wait_until(lambda: bool(found()), PATIENCE_S)
    (number,) = found()
    return number


def _leads_a_session(process: int) -> bool:
    try:
        return os.getsid(process) == process
    except ProcessLookupError:
        return False


def _command(process: int) -> bytes:
    try:
        return Path(f"/proc/{process}/cmdline").read_bytes()
    except OSError:
        return b""


def _is_as_it_was_made(folder: Path, count: int = COUNT) -> bool:
    with open_recording(folder) as recording:
        same = [made.same(recording.step(info.index), made.step(info.index)) for info in recording.infos]
        return len(same) == count and all(same) and verify(folder / "recording.h5") == []


def test_what_was_gathered_beforehand_is_the_same_recording(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    writer = CampaignWriter(folder, made.meta(status="running"))
    _write(writer, range(1, COUNT + 1), told=False)
    ahead = Gathering(folder)
    for _ in range(MANY):
        ahead.step_over()
    wait_until(lambda: _all_gathered(folder), PATIENCE_S)
    begun, files = ahead.begun(), finished_steps(folder)
    assert begun is not None
    assert begun.files == tuple(file.name for file in files)
    combine(files, tmp_path / "at_once.h5", made.meta())
    combine(files, tmp_path / "begun.h5", made.meta(), begun)
    with h5py.File(tmp_path / "at_once.h5") as one, h5py.File(tmp_path / "begun.h5") as other:
        assert one.attrs["manifest"] == other.attrs["manifest"]
        assert list(one["steps"]) == list(other["steps"])
        assert [step.attrs["manifest"] for step in one["steps"].values()] == [
            step.attrs["manifest"] for step in other["steps"].values()
        ]
    assert verify(tmp_path / "begun.h5") == []
    assert not begun.path.exists()
    writer.release()


@pytest.mark.slow
def test_a_long_campaign_is_finished_with_what_came_after_the_last_look_too(writer: CampaignWriter) -> None:
    wait_until(lambda: bool(_left(writer.folder)), PATIENCE_S)
    _write(writer, range(COUNT + 1, COUNT + 3))
    writer.finish("complete")
    assert sorted(item.name for item in writer.folder.iterdir()) == ["journal.jsonl", "recording.h5"]
    assert _is_as_it_was_made(writer.folder, COUNT + 2)


def test_a_short_campaign_starts_no_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gathering, "own_process", lambda *_, **__: pytest.fail("a process was started"))
    ahead = Gathering(tmp_path)
    for _ in range(MANY - 1):
        ahead.step_over()
    assert ahead.begun() is None


@pytest.mark.slow
def test_where_no_process_can_be_started_all_is_gathered_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", str(tmp_path / "no_python"))
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running"))
    _write(writer, range(1, COUNT + 1))
    writer.finish("complete")
    assert _is_as_it_was_made(tmp_path / "c")


@pytest.mark.skipif(sys.platform != "linux", reason="finds the process as Linux lists it")
@pytest.mark.parametrize(
    "delay_s", [0.0, *(pytest.param(delay_s, marks=pytest.mark.slow) for delay_s in (0.1, 0.4, 0.7))]
)
def test_killed_at_any_moment_it_costs_only_time(writer: CampaignWriter, delay_s: float) -> None:
    process = _gatherer(writer.folder)
    time.sleep(delay_s)
    os.kill(process, signal.SIGKILL)
    writer.finish("complete")
    assert sorted(item.name for item in writer.folder.iterdir()) == ["journal.jsonl", "recording.h5"]
    assert _is_as_it_was_made(writer.folder)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="finds the process as Linux lists it")
def test_one_that_hangs_is_not_waited_for_for_ever(writer: CampaignWriter, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gathering, "_ANSWERS_WITHIN_S", 0.5)
    os.kill(_gatherer(writer.folder), signal.SIGSTOP)
    writer.finish("complete")
    assert _left(writer.folder) == []
    assert _is_as_it_was_made(writer.folder)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="finds the process as Linux lists it")
def test_it_ends_with_the_program_that_started_it_and_leaves_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    command = [sys.executable, "-m", "tests.benchctl.recordings.writing_process", str(folder), "told", str(COUNT)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as program:
        try:
            assert program.stdout is not None
            for _ in range(COUNT):
                program.stdout.readline()
            process = _gatherer(folder)
            wait_until(lambda: bool(_left(folder)), PATIENCE_S)
        finally:
            program.kill()
    wait_until(lambda: not _command(process), PATIENCE_S)
    assert _left(folder) == []
    assert recover(folder).whole == COUNT
    assert _is_as_it_was_made(folder)


@pytest.mark.slow
def test_a_campaign_that_is_let_go_of_keeps_its_steps_and_nothing_of_what_was_gathered(writer: CampaignWriter) -> None:
    wait_until(lambda: bool(_left(writer.folder)), PATIENCE_S)
    writer.release()
    assert _left(writer.folder) == []
    assert _is_as_it_was_made_in_steps(writer.folder)


def _is_as_it_was_made_in_steps(folder: Path) -> bool:
    with open_recording(folder) as recording:
        return all(made.same(recording.step(index), made.step(index)) for index in range(1, COUNT + 1))


def test_a_step_that_changed_before_it_was_gathered_is_said_in_the_end(tmp_path: Path) -> None:
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running"))
    _write(writer, range(1, 3))
    first, _ = finished_steps(writer.folder)
    with h5py.File(first, "r+") as file:
        file["steps/0001/gyro_v"][3] += 1e-9
    _write(writer, range(3, COUNT + 1))
    with pytest.raises(UsageError, match="step 0001, channel gyro_v: samples changed"):
        writer.finish("complete")
    writer.release()
    assert len(finished_steps(writer.folder)) == COUNT
    assert _left(writer.folder) == []


def _cut_short(begun: Path) -> None:
    begun.write_bytes(begun.read_bytes()[:-1000])


def _emptied(begun: Path) -> None:
    begun.write_bytes(b"")


def _without_a_step(begun: Path) -> None:
    with h5py.File(begun, "r+") as file:
        del file["steps/0002"]


@pytest.mark.parametrize("harm", [_cut_short, _emptied, _without_a_step, Path.unlink])
def test_what_cannot_be_gone_on_with_is_gathered_anew(tmp_path: Path, harm: Callable[[Path], None]) -> None:
    folder = tmp_path / "c"
    writer = CampaignWriter(folder, made.meta(status="running"))
    _write(writer, range(1, 4))
    files = finished_steps(folder)
    begin(tmp_path / "begun.h5")
    add(tmp_path / "begun.h5", files[:2])
    begun = Begun(tmp_path / "begun.h5", tuple(file.name for file in files[:2]))
    harm(begun.path)
    gather(folder, made.meta(), "complete", "", begun)
    writer.release()
    assert _is_as_it_was_made(folder, 3)
    assert not begun.path.exists()


def test_steps_that_were_gathered_in_another_order_are_gathered_anew(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    writer = CampaignWriter(folder, made.meta(status="running"))
    _write(writer, range(1, 4))
    files = finished_steps(folder)
    gathered = [files[0], files[2]]
    begin(tmp_path / "begun.h5")
    add(tmp_path / "begun.h5", gathered)
    gather(folder, made.meta(), "complete", "", Begun(tmp_path / "begun.h5", tuple(file.name for file in gathered)))
    writer.release()
    with open_recording(folder) as recording:
        assert [info.index for info in recording.infos] == [1, 2, 3]
    assert _is_as_it_was_made(folder, 3)
