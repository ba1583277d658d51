import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchctl.bench import load_bench
from benchctl.doctor.disk import (
    disk_findings,
    file_system_finding,
    growing_file_finding,
    locks_finding,
    room_finding,
)
from tests.benchctl.lock_place import own_lock_place

BENCH = load_bench("simulated")
MOUNTED = [
    ("/dev/sda1", "/", "ext4"),
    ("server:/export", "/home/lab share", "nfs4"),
    ("cover", "/mnt/cloud", "ext4"),
    ("tmpfs", "/home/lab share/fast", "tmpfs"),
    ("me@there:", "/mnt/cloud", "fuse.sshfs"),
    ("/dev/sdb1", "/mnt/stick", "fuseblk"),
]
AS_NOBODY = """
import os, sys
from pathlib import Path
from benchctl.bench import load_bench
from benchctl.doctor.disk import disk_findings
bench = load_bench("simulated")
os.setgid(65534); os.setuid(65534)
for each in disk_findings(Path(sys.argv[1]), bench):
    print(each.verdict, each.what, each.message, each.unusable, sep="|")
"""


def test_a_folder_that_may_be_written_to_is_tried_and_left_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own_lock_place(tmp_path, monkeypatch)
    (tmp_path / "lab").mkdir()
    found = {finding.what: finding for finding in disk_findings(tmp_path / "lab" / "not" / "yet", BENCH)}
    assert {"folder", "room", "file system", "locks", "HDF5", "locks of instruments"} == found.keys()
    assert not [finding for finding in found.values() if finding.verdict == "bad"]
    assert f"created in {tmp_path / 'lab'} with" in found["folder"].message
    assert "another process reads a file" in found["HDF5"].message
    assert list((tmp_path / "lab").iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() != 0, reason="needs root, to become another user")
def test_a_folder_of_somebody_else_is_bad_and_says_whose_fault_it_is(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir(mode=0o700)
    ran = subprocess.run([sys.executable, "-c", AS_NOBODY, tmp_path], capture_output=True, text=True, check=True)
    verdict, what, says, unusable = ran.stdout.splitlines()[0].split("|")
    assert (verdict, what, unusable) == ("bad", "folder", "True")
    assert says.endswith("cannot be written: Permission denied")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_place_that_takes_no_file_fails_in_words(tmp_path: Path) -> None:
    (tmp_path / "trial.h5").symlink_to("/dev/full")
    finding = growing_file_finding(tmp_path)
    assert (finding.verdict, finding.unusable) == ("bad", True)
    assert "\n" not in finding.message


def test_a_place_without_locks_fails_in_words(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    finding = locks_finding(tmp_path / "file")
    assert (finding.verdict, finding.unusable) == ("bad", True)
    assert "cannot be locked by" in finding.message
    assert "name a folder on a local disk with --out DIR" in finding.do


def test_a_file_in_the_place_of_the_folder_is_bad(tmp_path: Path) -> None:
    (tmp_path / "results").write_text("no folder")
    (finding, _) = disk_findings(tmp_path / "results", BENCH)
    assert (finding.verdict, finding.unusable) == ("bad", True)
    assert "Not a directory" in finding.message


def test_too_little_room_for_the_longest_campaign_is_a_warning(tmp_path: Path) -> None:
    fast = BENCH.digitizer.model_copy(update={"sample_rate_hz": 1e9})
    finding = room_finding(tmp_path, BENCH.model_copy(update={"digitizer": fast}))
    assert finding.verdict == "look"
    assert "acceptance, the longest procedure, records" in finding.message
    assert room_finding(tmp_path, BENCH).verdict == "ok"


@pytest.mark.parametrize(
    ("place", "verdict", "message"),
    [
        ("/home/lab share/2026", "look", "nfs4 on server:/export: on the network"),
        ("/home/lab share/fast/x", "look", "tmpfs on tmpfs: in memory"),
        ("/home/lab shared", "ok", "ext4 on /dev/sda1"),
        ("/mnt/cloud", "look", "fuse.sshfs on me@there:: on the network"),
        ("/mnt/stick", "ok", "fuseblk on /dev/sdb1"),
    ],
)
def test_the_file_system_of_a_folder_is_that_of_the_nearest_mount(place: str, verdict: str, message: str) -> None:
    finding = file_system_finding(Path(place), MOUNTED)
    assert (finding.verdict, finding.message.startswith(message)) == (verdict, True)


def test_the_file_system_of_this_machine_is_known(tmp_path: Path) -> None:
    assert " on " in file_system_finding(tmp_path).message
    assert file_system_finding(tmp_path, []).verdict == "ok"
