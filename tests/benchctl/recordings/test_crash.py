"""A writing process is killed with SIGKILL; whatever it had finished is whole, and at most half a second is lost."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import xarray

from benchctl.recordings.model import Step
from benchctl.recordings.reader import open_recording
from benchctl.recordings.recover import recover
from benchctl.recordings.verify import verify
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made
from tests.slowness import lateness

ROOT = Path(__file__).resolve().parents[3]

_WAITS = 3
"""Times that a sample may wait for a busy machine's core before it is in the file: the timer, the flush, the disk."""


@contextmanager
def _writing(folder: Path, how: str, much: float) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "tests.benchctl.recordings.writing_process", str(folder), how, str(much)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        try:
            yield process
        finally:
            process.kill()


def _lines(process: subprocess.Popen[str], count: int | None = None) -> list[str]:
    """The next lines of what it prints; all that are left where no count is given."""
    assert process.stdout is not None
    return [process.stdout.readline() for _ in range(count)] if count else process.stdout.readlines()


@pytest.mark.parametrize("period_s", [pytest.param(0.02, marks=pytest.mark.slow), 0.2, 0.45])
def test_at_most_half_a_second_is_lost(tmp_path: Path, period_s: float) -> None:
    folder = tmp_path / "c"
    behind = []
    with lateness() as late, _writing(folder, "slowly", period_s) as process:
        printed: list[str] = []
        for _ in range(round(1.4 / period_s)):
            printed += _lines(process, 1)
            in_file = _part(folder)["time_s"]
            behind.append(float(printed[-1]) - (in_file[-1] if in_file.size else float(printed[0])))
        process.kill()
        printed += _lines(process)
    part = _part(folder)
    assert max([*behind, float(printed[-1]) - part["time_s"][-1]]) <= 0.5 + _WAITS * late.worst_s
    assert not part.info.whole
    assert part.info.samples == part["gyro_v"].size > 0
    assert np.array_equal(part["gyro_v"], part["time_s"] + 1.0)


def _part(folder: Path) -> Step:
    """The step being written, as its file has it; the step before it must be whole."""
    with open_recording(folder) as recording:
        assert made.same(recording.step(1), made.step(1))
        return recording.step(2)


@pytest.mark.parametrize(
    "delay_s", [0.1, pytest.param(0.6, marks=pytest.mark.slow), 0.73, pytest.param(0.97, marks=pytest.mark.slow)]
)
def test_of_points_written_one_by_one_all_that_are_half_a_second_old_are_recovered(
    tmp_path: Path, delay_s: float
) -> None:
    folder = tmp_path / "c"
    with lateness() as late, _writing(folder, "points", 0) as process:
        (began,) = _lines(process, 1)
        time.sleep(delay_s)
        killed_s = time.monotonic()
        process.kill()
    with open_recording(recover(folder).recording) as recording:
        found = recording.step(1)
    assert np.array_equal(found["gyro_v"], np.arange(1.0, found.info.samples + 1))
    assert (found["time_s"][-1] if found.info.samples else float(began)) >= killed_s - 0.5 - _WAITS * late.worst_s
    assert verify(folder) == []


def test_points_before_a_silence_are_recovered_though_nothing_came_after_them(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    with lateness() as late, _writing(folder, "points", 7) as process:
        _lines(process, 2)
        time.sleep(0.5)
        time.sleep(_WAITS * late.worst_s)
        process.kill()
    with open_recording(recover(folder).recording) as recording:
        assert recording.step(1)["gyro_v"].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]


def test_another_process_reads_what_is_being_written(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    seen = []
    with _writing(folder, "slowly", 0.02) as process:
        _lines(process, 1)
        for _ in range(3):
            seen_s = time.monotonic()
            while float(_lines(process, 1)[0]) < seen_s + 0.4:
                pass
            with open_recording(folder) as recording:
                assert recording.step(1).info.whole
                part = recording.step(2)
            assert np.array_equal(part["gyro_v"], part["time_s"] + 1.0)
            seen.append(part.info.samples)
            (file,) = (folder / "steps").glob("0002*.part")
            with xarray.open_dataset(file, engine="h5netcdf", group="steps/0002", driver_kwds={"swmr": True}) as data:
                assert data["gyro_v"].size >= part.info.samples
    assert 0 < seen[0] < seen[1] < seen[2]


@pytest.mark.parametrize(
    "delay_s", [0.0, 0.05, 0.2, *(pytest.param(delay_s, marks=pytest.mark.slow) for delay_s in (0.013, 0.11, 0.37))]
)
def test_killed_at_any_moment_every_finished_step_is_whole(tmp_path: Path, delay_s: float) -> None:
    folder = tmp_path / "c"
    with _writing(folder, "fast", 12) as process:
        first = _lines(process, 1)
        time.sleep(delay_s)
        process.kill()
        closed = [line.strip() for line in [*first, *_lines(process)]]
    indices = {int(line) for line in closed if line != "finished"}
    with open_recording(folder) as recording:
        whole = {info.index for info in recording.infos if info.whole}
        assert indices <= whole
        for index in whole:
            assert made.same(recording.step(index), made.step(index))
        gathering = '"kind": "finish"' in recording.meta.provenance["journal"]
        assert recording.meta.status == ("complete" if gathering else "aborted")
    unfinished = "the campaign's other files cannot be checked" if gathering else "was not finished"
    assert [problem.message for problem in verify(folder) if unfinished not in problem.message] == []


def test_a_step_whose_writing_had_only_begun_is_left_out_and_said(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    with _writing(folder, "slowly", 0.02) as process:
        _lines(process, 1)
    (folder / "steps" / "0003_next.h5.part").write_bytes(b"")
    with open_recording(folder) as recording:
        assert [info.index for info in recording.infos] == [1, 2]
        assert len(recording.notes) == 2
        assert "0003_next.h5.part" in recording.notes[1]


def test_a_campaign_is_running_while_its_program_runs_and_aborted_once_that_was_killed(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    with _writing(folder, "slowly", 0.02) as process:
        _lines(process, 1)
        with open_recording(folder) as recording:
            assert (recording.meta.status, recording.notes) == ("running", ())
        process.kill()
        process.wait()
        with open_recording(folder) as recording:
            assert recording.meta.status == "aborted"
            assert "its program died" in recording.meta.provenance["reason"]
            assert f"benchctl recover {folder} closes it" in recording.notes[0]


def test_a_finished_step_that_was_cut_short_is_an_error_that_names_it(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    with _writing(folder, "slowly", 0.02) as process:
        _lines(process, 1)
    (file,) = (folder / "steps").glob("0001*.h5")
    file.write_bytes(file.read_bytes()[:5000])
    with pytest.raises(UsageError, match=r"0001_rate_\+1.h5: was cut short: 5000 of"):
        open_recording(folder)
