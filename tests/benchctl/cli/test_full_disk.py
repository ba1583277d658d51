"""A disk that really is full, on a file system of a few megabytes that the test mounts for itself."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchctl.recordings.reader import open_recording
from benchctl.recordings.recover import recover
from benchctl.recordings.verify import verify

IN_A_NAMESPACE = ("unshare", "--user", "--map-root-user", "--mount")


def _may_mount() -> bool:
    if sys.platform != "linux" or shutil.which("unshare") is None:
        return False
    return (
        subprocess.run([*IN_A_NAMESPACE, "mount", "-t", "tmpfs", "none", "/mnt"], capture_output=True).returncode == 0
    )


pytestmark = pytest.mark.skipif(not _may_mount(), reason="this machine lets no user mount a small file system")

PROCEDURE = """
from benchctl.plan import ConstantRate, Static, procedure

@procedure()
def turns(run_s: float = 3000.0):
    '''Rest, then turn.'''
    yield Static(duration_s=10.0)
    yield ConstantRate(rate_dps=60.0, duration_s=run_s)
    yield ConstantRate(rate_dps=-60.0, duration_s=run_s)
"""


def _on_a_disk_of(megabytes: int, folder: Path, script: str) -> subprocess.CompletedProcess[str]:
    """Run a script in `folder` with a small file system at `disk`; what is on it at the end is kept in `kept`."""
    (folder / "disk").mkdir()
    (folder / "turns.py").write_text(PROCEDURE)
    whole = f"mount -t tmpfs -o size={megabytes}m none disk\n{script}\nstatus=$?\ncp -r disk kept\nexit $status"
    return subprocess.run([*IN_A_NAMESPACE, "sh", "-c", whole], cwd=folder, capture_output=True, text=True, timeout=150)


@pytest.mark.slow
def test_a_disk_without_room_is_a_problem_of_the_check_and_refused_by_the_run_before_anything_is_written(
    tmp_path: Path,
) -> None:
    benchctl = f"{sys.executable} -m benchctl"
    plan = "turns.py --bench simulated --out disk/c --json"
    ran = _on_a_disk_of(
        120, tmp_path, f"{benchctl} check {plan} check.json; echo $? > checked; {benchctl} run {plan} run.json"
    )
    assert ((tmp_path / "checked").read_text(), ran.returncode) == ("2\n", 2)
    checked = json.loads((tmp_path / "check.json").read_text())
    assert checked["disk_bytes"] > checked["disk_free_bytes"] > 80e6
    assert [problem["step"] for problem in checked["problems"]] == [2]
    assert "the campaign needs 111 MB, 92 MB are free at disk/c" in checked["problems"][0]["says"]
    assert (
        "the disk would be full: the campaign needs 111 MB" in json.loads((tmp_path / "run.json").read_text())["error"]
    )
    assert list((tmp_path / "kept").iterdir()) == []


def test_a_disk_that_is_filled_to_the_last_byte_stops_the_run_safely_with_all_finished_steps(tmp_path: Path) -> None:
    fill = "while ! ls disk/c/steps/0002*.part 2> /dev/null; do sleep 0.02; done; cat /dev/zero > disk/filler"
    run = f"{sys.executable} -m benchctl run turns.py --bench simulated --out disk/c --json result.json"
    ran = _on_a_disk_of(160, tmp_path, f"({fill}) 2> /dev/null & {run} -q")
    assert ran.returncode == 3, ran.stderr
    result = json.loads((tmp_path / "result.json").read_text())
    assert (result["ok"], result["status"], result["steps"]) == (False, "aborted", {"planned": 3, "whole": 1})
    assert "cannot be written" in result["error"]
    assert "not known to be at rest" not in result["error"]
    assert len(ran.stderr.strip().splitlines()) == 1
    campaign = tmp_path / "kept" / "c"
    with open_recording(campaign) as recording:
        assert recording.meta.status == "aborted"
        assert recording.step(1).info.whole
        assert recording.step(1)["gyro_v"].size == 5000
    closed = recover(campaign)  # once there is room again
    assert (closed.status, closed.steps[0].whole) == ("aborted", True)
    assert verify(campaign) == []
