from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import h5py
import pytest

from benchctl.recordings.hdf5_files import RecordingFile
from benchctl.recordings.step_writer import StepWriter
from benchctl.recordings.writer import write_recording
from tests.benchctl.recordings import made

fcntl = pytest.importorskip("fcntl", reason="Windows has no locks of this kind, and HDF5 takes none there")

ROOT = Path(__file__).parents[3]
READER = """
import sys, time, h5py
folder, seen = sys.argv[1], 0
from pathlib import Path
print("looking", flush=True)
while not (Path(folder) / "recording.h5").exists():
    for path in (Path(folder) / "steps").glob("*.part"):
        try:
            h5py.File(path, "r", swmr=True).close()
            seen += 1
        except OSError:
            pass
print(seen)
"""


@contextmanager
def _locked(path: Path, how: int) -> Iterator[None]:
    """The file's lock as another process that has just opened it holds it; raises where it is taken."""
    with path.open("rb") as file:
        fcntl.flock(file, how | fcntl.LOCK_NB)
        yield


def test_a_step_begins_while_somebody_opens_its_file(tmp_path: Path) -> None:
    path = tmp_path / "0001_rate_+1.h5.part"
    path.touch()
    with _locked(path, fcntl.LOCK_SH):
        step = StepWriter(tmp_path, made.info(1), made.STREAMED, made.meta(status="running"))
        assert step.path == path
        step.append(made.streamed(0.0, 5))
        step.close(made.info(1))
    with h5py.File(tmp_path / "0001_rate_+1.h5") as file:
        assert len(file["steps/0001/time_s"]) == 5


def test_whoever_reads_a_step_that_is_written_locks_nothing(tmp_path: Path) -> None:
    step = StepWriter(tmp_path, made.info(1), made.STREAMED, made.meta(status="running"))
    reader = RecordingFile(step.path)
    with _locked(step.path, fcntl.LOCK_EX):
        reader.close()
    step.close(made.info(1))


def test_a_finished_recording_is_opened_by_others_of_the_same_process_as_they_are_used_to(tmp_path: Path) -> None:
    path = tmp_path / "whole.h5"
    write_recording(path, made.meta(), [made.step(1)])
    with closing(RecordingFile(path)) as ours, h5py.File(path) as theirs:
        assert len(theirs["steps/0001/time_s"]) == ours.infos[0].samples


@pytest.mark.slow
def test_programs_that_open_every_step_with_locks_of_their_own_do_not_stop_the_run(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    readers = [
        subprocess.Popen([sys.executable, "-c", READER, str(folder)], stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    try:
        for reader in readers:
            assert reader.stdout is not None
            assert reader.stdout.readline() == "looking\n"
        writer = [sys.executable, "-m", "tests.benchctl.recordings.writing_process", str(folder), "fast", "200"]
        done = subprocess.run(writer, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
        assert (done.returncode, done.stderr) == (0, "")
        assert sum(int(reader.communicate(timeout=30)[0]) for reader in readers) > 0
    finally:
        for reader in readers:
            reader.kill()
            reader.wait()
    assert (folder / "recording.h5").exists()
