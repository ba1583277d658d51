"""Locks between real processes."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from benchctl.locks import Lock, is_held
from benchctl_instruments.errors import UsageError

HOLDER = """
import sys
from pathlib import Path
from benchctl.locks import Lock
lock = Lock(Path(sys.argv[1]), "the bench")
lock.acquire("a long soak")
print("held", flush=True)
sys.stdin.readline()
"""


@contextmanager
def held_by_another(path: Path) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        try:
            yield process
        finally:
            process.kill()


def test_whoever_is_refused_is_told_who_has_it_what_for_and_since_when(tmp_path: Path) -> None:
    path = tmp_path / "bench.lock"
    with held_by_another(path) as process:
        assert is_held(path)
        since = json.loads(path.with_suffix(".json").read_text())["since"]
        with pytest.raises(UsageError) as caught:
            Lock(path, "the bench").acquire("another run")
    holder = f"process {process.pid} (a long soak, since {since})"
    assert str(caught.value) == f"the bench is in use by {holder}; wait until that is over, or stop it"


def test_a_killed_process_leaves_no_lock_behind(tmp_path: Path) -> None:
    path = tmp_path / "bench.lock"
    with held_by_another(path) as process:
        process.kill()
        process.wait()
        assert path.exists()
        assert not is_held(path)
        lock = Lock(path, "the bench")
        lock.acquire("the next run")
        assert json.loads(path.with_suffix(".json").read_text())["pid"] == os.getpid()
        lock.release()


def test_a_released_lock_leaves_no_file_and_may_be_released_again(tmp_path: Path) -> None:
    lock = Lock(tmp_path / "bench.lock", "the bench")
    lock.acquire("a run")
    assert is_held(tmp_path / "bench.lock")
    lock.release()
    lock.release()
    assert list(tmp_path.iterdir()) == []
    assert not is_held(tmp_path / "bench.lock")


@pytest.mark.parametrize("note", ["{", "[]", "{}", "[" * 100_000])
def test_a_lock_whose_holder_left_no_note_is_refused_all_the_same(note: str, tmp_path: Path) -> None:
    path = tmp_path / "bench.lock"
    with held_by_another(path):
        path.with_suffix(".json").write_text(note)
        with pytest.raises(UsageError, match="is in use by another process; wait"):
            Lock(path, "the bench").acquire("another run")


def test_a_lock_where_no_file_can_be_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(UsageError, match=r"the bench cannot be locked by .*; its folder must be writable"):
        Lock(tmp_path / "file" / "bench.lock", "the bench").acquire("a run")
