import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchctl.bench import load_bench
from benchctl.doctor.machine.file_systems import file_system_of, keeps_nothing, on_the_network
from benchctl.doctor.machine.folder import folder_findings, growing_file_finding, locks_finding, room_finding
from tests.benchctl.lock_place import own_lock_place

BENCH = load_bench("simulated")
MOUNTS = """\
22 1 8:1 / / rw,relatime shared:1 - ext4 /dev/sda1 rw
23 22 0:44 / /home/lab\\040share rw,relatime shared:2 - nfs4 server:/export rw
24 22 0:45 / /home/lab\\040share/fast rw - tmpfs tmpfs rw
25 22 0:46 / /mnt/cloud rw - fuse.sshfs me@there: rw
not a line of it
"""
AS_NOBODY = """
import os, sys
from pathlib import Path
from benchctl.bench import load_bench
from benchctl.doctor.machine.folder import folder_findings
bench = load_bench("simulated")
os.setgid(65534); os.setuid(65534)
for each in folder_findings(Path(sys.argv[1]), bench):
    print(each.verdict, each.what, each.says, each.unusable, sep="|")
"""


def test_a_folder_that_may_be_written_to_is_tried_and_left_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own_lock_place(tmp_path, monkeypatch)
    (tmp_path / "lab").mkdir()
    found = {finding.what: finding for finding in folder_findings(tmp_path / "lab" / "not" / "yet", BENCH)}
    assert {"folder", "room", "file system", "locks", "HDF5", "locks of instruments"} == found.keys()
    assert not [finding for finding in found.values() if finding.verdict == "bad"]
    assert f"made in {tmp_path / 'lab'} when" in found["folder"].says
    assert "read by another process" in found["HDF5"].says
    assert list((tmp_path / "lab").iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() != 0, reason="needs root, to become another user")
def test_a_folder_of_somebody_else_is_bad_and_says_whose_fault_it_is(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir(mode=0o700)
    ran = subprocess.run([sys.executable, "-c", AS_NOBODY, tmp_path], capture_output=True, text=True, check=True)
    verdict, what, says, unusable = ran.stdout.splitlines()[0].split("|")
    assert (verdict, what, unusable) == ("bad", "folder", "True")
    assert says.endswith("may not be written to: Permission denied")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_place_that_takes_no_file_fails_in_words(tmp_path: Path) -> None:
    (tmp_path / "trial.h5").symlink_to("/dev/full")
    finding = growing_file_finding(tmp_path)
    assert (finding.verdict, finding.unusable) == ("bad", True)
    assert "\n" not in finding.says


def test_a_place_without_locks_fails_in_words(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    finding = locks_finding(tmp_path / "file")
    assert (finding.verdict, finding.unusable) == ("bad", True)
    assert "cannot be locked by" in finding.says
    assert "name a folder on a local disk with --out DIR" in finding.do


def test_a_file_in_the_place_of_the_folder_is_bad(tmp_path: Path) -> None:
    (tmp_path / "results").write_text("no folder")
    (finding, _) = folder_findings(tmp_path / "results", BENCH)
    assert (finding.verdict, finding.unusable) == ("bad", True)
    assert "Not a directory" in finding.says


def test_too_little_room_for_the_longest_campaign_is_a_warning(tmp_path: Path) -> None:
    fast = BENCH.digitizer.model_copy(update={"sample_rate_hz": 1e9})
    finding = room_finding(tmp_path, BENCH.model_copy(update={"digitizer": fast}))
    assert finding.verdict == "look"
    assert "acceptance, the longest procedure, records" in finding.says
    assert room_finding(tmp_path, BENCH).verdict == "ok"


@pytest.mark.parametrize(
    ("place", "kind", "device"),
    [
        ("/home/lab share/2026", "nfs4", "server:/export"),
        ("/home/lab share/fast/x", "tmpfs", "tmpfs"),
        ("/home/lab shared", "ext4", "/dev/sda1"),
        ("/mnt/cloud", "fuse.sshfs", "me@there:"),
    ],
)
def test_the_file_system_of_a_folder_is_that_of_the_nearest_mount(
    tmp_path: Path, place: str, kind: str, device: str
) -> None:
    (tmp_path / "mountinfo").write_text(MOUNTS)
    assert file_system_of(Path(place), tmp_path / "mountinfo") == (kind, device)


def test_network_and_memory_are_told_from_disks(tmp_path: Path) -> None:
    assert on_the_network("nfs4")
    assert on_the_network("fuse.sshfs")
    assert not on_the_network("fuseblk")
    assert keeps_nothing("tmpfs")
    assert file_system_of(tmp_path, tmp_path / "absent") == ("", "")
