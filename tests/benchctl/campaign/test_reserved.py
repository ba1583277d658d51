"""One run a bench, whichever bench file names its instruments."""

import os
import shutil
import socket
import stat
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

from benchctl.bench import Bench, load_bench
from benchctl.campaign.opened import open_bench
from benchctl.campaign.reserved import BenchInUseError, lock_files, lock_folder, reserved
from benchctl.locks import is_held
from benchctl_instruments.errors import BenchNotReadyError, UsageError
from tests.benchctl.lock_place import own_lock_place

ROOT = Path(__file__).resolve().parents[3]
AS_ANOTHER = f"""
import encodings.idna, os, sys
from pathlib import Path
sys.path.insert(0, {str(ROOT)!r})
from tests.benchctl.campaign import test_reserved
import benchctl.campaign.reserved as where
where.LOCK_PLACES = (Path(sys.argv[1]),)
os.umask(0o077); os.setgid(65534); os.setuid(65534)
with where.reserved(test_reserved.ONE, "theirs"):
    print("held", flush=True)
    sys.stdin.read() or __import__("time").sleep(600)
"""


@pytest.fixture(autouse=True)
def locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the locks, which is the tests' own."""
    return own_lock_place(tmp_path, monkeypatch)


def _bench(table: str, chamber: str, digitizer: str) -> Bench:
    bench = load_bench("simulated")
    entries: dict[str, Any] = {
        name: getattr(bench, name).model_copy(update={"address": address})
        for name, address in (("rate_table", table), ("chamber", chamber), ("digitizer", digitizer))
    }
    return bench.model_copy(update={"simulated": False, **entries})


ONE = _bench("tcp://table:1", "serial:///dev/ttyS7?baud=9600", "tcp://t7:502")
OTHER = _bench("tcp://another-table:1", "serial:///dev/ttyS7?baud=19200", "tcp://another-t7:502")


def test_two_benches_that_share_a_chamber_exclude_each_other_and_nothing_is_sent(locks: Path) -> None:
    with reserved(ONE, "campaign /data/c"):
        with (
            pytest.raises(
                BenchInUseError, match=r"^chamber at serial:///dev/ttyS7\?baud=19200 is in use by process \d+ \(cam"
            ) as caught,
            open_bench(OTHER),
        ):
            pass
        assert caught.value.exit_status == 3
        assert not any(map(is_held, lock_files("tcp://another-table:1")))
    with reserved(OTHER, "afterwards"):
        assert len(list(locks.glob("*.lock"))) == 3
    assert list(locks.iterdir()) == []


def test_two_instruments_of_a_bench_may_be_on_one_bus(locks: Path) -> None:
    with reserved(_bench("tcp://table:1", "serial:///dev/ttyS7", "serial:///dev/ttyS7"), "a run"):
        assert len(list(locks.glob("*.lock"))) == 2


def test_a_bench_is_given_back_where_its_instruments_do_not_answer(locks: Path) -> None:
    nobody = _bench("tcp://127.0.0.1:1", "tcp://127.0.0.1:2", "tcp://127.0.0.1:3")
    with pytest.raises(BenchNotReadyError, match="rate_table: "), open_bench(nobody):
        pass
    assert list(locks.iterdir()) == []


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("tcp://LAB-7:702", "tcp://lab-7:702", True),
        ("socket://lab-7:702", "tcp://lab-7:702", True),
        ("tcp://lab-7:702", "tcp://lab-7:703", False),
        ("tcp://localhost:502", "tcp://127.0.0.1:502", True),
        ("tcp://LocalHost:0502", "tcp://[::1]:502", True),
        ("tcp://[::ffff:127.0.0.1]:502", "tcp://0.0.0.0:502", True),
        (f"tcp://{socket.gethostname()}:502", "tcp://localhost:502", True),
        ("tcp://192.0.2.7:502", "tcp://[::ffff:192.0.2.7]:502", True),
        ("tcp://192.0.2.7:502", "tcp://192.0.2.8:502", False),
        ("serial:///dev/ttyS1?baud=9600", "serial:///dev/../dev/ttyS1?baud=19200", True),
        ("serial:///dev/ttyS1", "serial:///dev/ttyS2", False),
    ],
)
def test_an_instrument_has_the_same_locks_however_its_address_is_written(one: str, other: str, same: bool) -> None:
    assert (lock_files(one) == lock_files(other)) is same


def test_a_link_to_a_port_is_that_port(tmp_path: Path) -> None:
    (tmp_path / "by-id").symlink_to("/dev/ttyS1")
    assert lock_files(f"serial://{tmp_path}/by-id") == lock_files("serial:///dev/ttyS1")


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() != 0, reason="needs root, to make a device node")
def test_a_copy_of_a_ports_node_is_that_port(tmp_path: Path) -> None:
    controller, port = os.openpty()
    name = os.ttyname(port)
    os.mknod(tmp_path / "table", stat.S_IFCHR | 0o600, os.stat(name).st_rdev)
    try:
        assert set(lock_files(f"serial://{tmp_path}/table")) & set(lock_files(f"serial://{name}"))
    finally:
        os.close(port)
        os.close(controller)


def test_the_stream_of_a_digitizer_belongs_to_its_run_too(locks: Path) -> None:
    def streaming_from(bench: Bench, address: str) -> Bench:
        return bench.model_copy(update={"digitizer": bench.digitizer.model_copy(update={"stream_address": address})})

    other = _bench("tcp://another-table:1", "serial:///dev/ttyS8", "tcp://another-t7:502")
    with (
        reserved(streaming_from(ONE, "tcp://t7:702"), "a run"),
        pytest.raises(BenchInUseError, match=r"^digitizer at tcp://another-t7:502 is in use by process"),
        reserved(streaming_from(other, "socket://T7:702"), "another"),
    ):
        pass


def test_a_name_of_several_addresses_is_locked_under_each(monkeypatch: pytest.MonkeyPatch) -> None:
    def two(host: str, *_: object, **__: object) -> list[Any]:
        return [(0, 0, 0, "", (ip, 0)) for ip in names.get(host, [host])]

    names = {"t7": ["192.0.2.7", "192.0.2.8"]}
    monkeypatch.setattr(socket, "getaddrinfo", two)
    assert lock_files("tcp://t7:502") == tuple(
        sorted((*lock_files("tcp://192.0.2.7:502"), *lock_files("tcp://192.0.2.8:502")))
    )
    named = _bench("tcp://192.0.2.1:1", "tcp://192.0.2.2:1", "tcp://t7:502")
    numbered = _bench("tcp://192.0.2.3:1", "tcp://192.0.2.4:1", "tcp://192.0.2.8:502")
    with (
        reserved(named, "a run"),
        pytest.raises(BenchInUseError, match=r"^digitizer at tcp://192\.0\.2\.8:502 is in use"),
        reserved(numbered, "another"),
    ):
        pass


def test_no_environment_variable_moves_the_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    there = lock_folder()
    for name in ("TMPDIR", "TEMP", "TMP", "XDG_RUNTIME_DIR", "HOME", "LOGNAME", "ProgramData"):
        monkeypatch.setenv(name, str(tmp_path))
    assert lock_folder() == there


def test_a_place_in_which_not_every_user_may_write_is_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = tuple(tmp_path / name for name in ("missing", "mine", "everybodys"))
    for place, mode in zip(places[1:], (0o755, 0o1777), strict=True):
        place.mkdir()
        place.chmod(mode)
    monkeypatch.setattr("benchctl.campaign.reserved.LOCK_PLACES", places)
    assert lock_folder() == tmp_path / "everybodys" / "benchctl"


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() != 0, reason="needs root, to become another user")
def test_a_run_of_another_user_is_refused_and_what_a_killed_run_of_another_user_left_is_no_obstacle(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folder = Path(tempfile.mkdtemp())  # which another user can reach, unlike one of pytest's
    own_lock_place(folder, monkeypatch)
    with subprocess.Popen([sys.executable, "-c", AS_ANOTHER, folder], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with (
            pytest.raises(BenchInUseError, match=rf"^rate_table .* in use by process {other.pid} \(theirs, since "),
            reserved(ONE, "mine"),
        ):
            pass
        other.kill()
    with reserved(ONE, "mine") as abandoned:
        assert abandoned == {"rate_table", "chamber", "digitizer"}
    with reserved(ONE, "mine") as abandoned:
        assert abandoned == frozenset()
    shutil.rmtree(folder)


def test_a_link_in_the_place_of_a_lock_or_its_note_is_not_followed(tmp_path: Path, locks: Path) -> None:
    (tmp_path / "precious").write_text("as it was")
    locks.mkdir()
    (path,) = lock_files("serial:///dev/ttyS7")
    path.with_suffix(".json").symlink_to(tmp_path / "precious")
    with reserved(ONE, "a run"):
        pass
    path.symlink_to(tmp_path / "precious")
    with pytest.raises(UsageError, match="cannot be locked"), reserved(ONE, "a run"):
        pass
    path.unlink()
    locks.rmdir()
    (tmp_path / "theirs").mkdir()
    locks.symlink_to(tmp_path / "theirs")
    with pytest.raises(UsageError, match="this is a link"), reserved(ONE, "a run"):
        pass
    assert (tmp_path / "precious").read_text() == "as it was"
    assert list((tmp_path / "theirs").iterdir()) == []
