import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchctl.campaign.reserved import lock_files, lock_folder, make_lock_folder
from benchctl.doctor.examine import line_findings
from benchctl.doctor.finding import Finding
from benchctl.locks import is_held
from tests.benchctl.doctor.benches import NOBODY, bench_at, server
from tests.benchctl.doctor.ptys import held, terminal
from tests.benchctl.lock_place import own_lock_place

ROOT = Path(__file__).resolve().parents[3]
HOLD = """
import sys
from pathlib import Path
from benchctl.locks import Lock
lock = Lock(Path(sys.argv[1]), "chamber")
lock.acquire("campaign results/2026-11-22")
print("held", flush=True)
sys.stdin.read()
"""
QUICK = {"options": {"timeout_s": 0.2}}
DRIVERS_OF_OTHERS = """
import time
class Lazy:
    def __init__(self, address, *, clock): pass
    def __enter__(self):
        time.sleep(60)
    def __exit__(self, *exc): pass
class Broken(Lazy):
    def __enter__(self):
        raise ZeroDivisionError("a fault of its own")
"""
ENTRY_POINTS = "[benchctl.instruments]\nchamber.lazy = lazy_driver:Lazy\nrate_table.broken = lazy_driver:Broken\n"
WITH_THEM = """
from benchctl.doctor.examine import line_findings
from tests.benchctl.doctor.benches import bench_at
for each in line_findings(bench_at({}, chamber={"model": "lazy"}, rate_table={"model": "broken"}), limit_s=1.0):
    print(each.verdict, each.where, each.message, sep="|")
"""


@pytest.fixture(autouse=True)
def _locks_of_the_tests_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own_lock_place(tmp_path / "run", monkeypatch)


def _bads(findings: list[Finding]) -> dict[str, Finding]:
    return {finding.where: finding for finding in findings if finding.verdict == "bad"}


@pytest.mark.slow
def test_one_instrument_that_does_not_answer_hides_none_of_the_others() -> None:
    with server(b"") as silent, server(b"\x00rubbish\r\n") as rubbish:
        began_s = time.monotonic()
        found = list(
            line_findings(bench_at({"rate_table": silent, "chamber": rubbish}, rate_table=QUICK, chamber=QUICK))
        )
        took_s = time.monotonic() - began_s
    bads = _bads(found)
    assert bads.keys() == {"rate_table", "chamber", "digitizer"}
    assert bads["rate_table"].message.startswith("silent: ")
    assert bads["chamber"].message.startswith("the received bytes are not of the protocol of watlow_f4t")
    assert any("port 3: the machine is there and refuses that port" in finding.message for finding in found)
    assert [finding.where for finding in found] == sorted(
        (finding.where for finding in found), key=["rate_table", "chamber", "digitizer"].index
    )
    assert took_s < 25.0
    assert not list(lock_folder().glob("*.lock"))


def test_an_instrument_that_another_program_has_is_named_and_left_alone() -> None:
    with server(b"") as chamber:
        make_lock_folder()
        (path,) = lock_files(chamber)
        with subprocess.Popen(
            [sys.executable, "-c", HOLD, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as holder:
            assert holder.stdout is not None
            assert holder.stdout.readline() == "held\n"
            found = list(line_findings(bench_at({"chamber": chamber})))
            assert is_held(path)
            holder.kill()
    (finding,) = [each for each in found if each.where == "chamber"]
    assert (finding.verdict, finding.what) == ("look", "in use")
    assert f"is in use by process {holder.pid} (campaign results/2026-11-22, since " in finding.message
    assert _bads(found).keys() == {"rate_table", "digitizer"}


@pytest.mark.slow
def test_a_driver_that_never_returns_has_a_time_limit_and_one_that_breaks_is_named(tmp_path: Path) -> None:
    (tmp_path / "lazy_driver.py").write_text(DRIVERS_OF_OTHERS)
    (tmp_path / "lazy-1.dist-info").mkdir()
    (tmp_path / "lazy-1.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: lazy\nVersion: 1\n")
    (tmp_path / "lazy-1.dist-info" / "entry_points.txt").write_text(ENTRY_POINTS)
    ran = subprocess.run(
        [sys.executable, "-c", WITH_THEM],
        env={**os.environ, "PYTHONPATH": os.pathsep.join((str(tmp_path), str(ROOT)))},
        capture_output=True,
        text=True,
        timeout=20,
    )
    told = ran.stdout.splitlines()
    assert "bad|rate_table|broken failed with ZeroDivisionError: a fault of its own" in told, ran.stderr
    assert f"bad|chamber|{NOBODY['chamber']}: not finished within 1 s" in told
    assert any(line.startswith("bad|digitizer|127.0.0.1, port 3: ") for line in told)


def test_an_address_that_is_none_is_the_inputs_fault() -> None:
    found = list(line_findings(bench_at({"chamber": "192.168.1.60"})))
    (finding,) = [each for each in found if each.where == "chamber"]
    assert (finding.verdict, finding.unusable) == ("bad", True)
    assert "expected tcp://HOST:PORT" in finding.message


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_nothing_is_sent_on_a_port_that_another_program_has_open() -> None:
    chamber = {"model": "watlow_f4"}
    with terminal() as device, held(device) as pid:
        found = list(line_findings(bench_at({"chamber": f"serial://{device}?baud=9600"}, chamber=chamber)))
    of_chamber = [each for each in found if each.where == "chamber"]
    assert [each.what for each in of_chamber] == ["speed", "port"]
    assert f"is in use by process {pid}" in of_chamber[-1].message


@pytest.mark.skipif(sys.platform == "win32", reason="a pty is a thing of POSIX")
@pytest.mark.slow
def test_two_instruments_on_one_line_are_asked_one_after_the_other() -> None:
    with terminal() as device:
        both = f"serial://{device}?baud=9600"
        bench = bench_at(
            {"chamber": both, "rate_table": both},
            chamber={"model": "watlow_f4", "options": {"timeout_s": 0.1}},
            rate_table={"model": "newport_esp301", "options": {"timeout_s": 0.1}},
        )
        bads = _bads(list(line_findings(bench)))
    assert bads["chamber"].message.startswith("silent: Watlow F4 at ")
    assert bads["rate_table"].message.startswith("silent: rate table ")
