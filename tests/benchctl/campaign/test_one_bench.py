"""One bench, one run: real processes on simulated instruments that another process serves."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from benchctl_instruments.digitizers.labjack_t7 import LabJackT7
from benchctl_instruments.simulated.clock import ScaledClock
from tests.benchctl.cli.processes import simulated_servers

PROCEDURE = """
from benchctl.plan import ConstantRate, procedure

@procedure()
def turn(duration_s: float = 2000.0):
    '''A rate that is kept.'''
    yield ConstantRate(rate_dps=60.0, duration_s=duration_s)
"""

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="not tried there")


class Lab:
    """A bench on a few servers, its files in `folder`, and what a stranger sees of its table."""

    def __init__(self, folder: Path, addresses: dict[str, str]) -> None:
        self.folder, self.addresses = folder, addresses
        table = urlsplit(addresses["rate_table"])
        self._line = socket.create_connection((table.hostname, table.port), timeout=5)
        self._replies = self._line.makefile("rb")
        text = (folder / "bench.toml").read_text(encoding="utf-8")
        (folder / "renamed.toml").write_text(text.replace("127.0.0.1", "LocalHost"), encoding="utf-8")

    def say(self, text: str) -> str:
        """What the table's controller replies to a stranger."""
        self._line.sendall(f"{text}\r\n".encode())
        return self._replies.readline()[8:].decode().strip()

    def close(self) -> None:
        self._replies.close()
        self._line.close()

    def wait_for_rate(self, rate_dps: float) -> None:
        deadline_s = time.monotonic() + 60
        while abs(float(self.say(":read:rate? 1")) - rate_dps) > 0.1:
            assert time.monotonic() < deadline_s, f"never at {rate_dps} deg/s"
            time.sleep(0.05)

    def run_arguments(self, name: str, bench: str, *more: str) -> Sequence[str | Path]:
        folder = self.folder
        verb = ("run", folder / "turn.py", "--bench", folder / bench, "--out", folder / name, "--quiet")
        return (sys.executable, "-m", "benchctl", *verb, *more)

    @contextmanager
    def running(self, name: str) -> Iterator[subprocess.Popen[str]]:
        """A run with the table at its rate and the digitizer streaming."""
        with subprocess.Popen(self.run_arguments(name, "bench.toml"), stderr=subprocess.PIPE, text=True) as run:
            try:
                self.wait_for_rate(60.0)
                deadline_s = time.monotonic() + 60
                while not any((self.folder / name / "steps").glob("0001_*")):
                    assert run.poll() is None
                    assert time.monotonic() < deadline_s
                    time.sleep(0.05)
                yield run
            finally:
                run.kill()


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[Lab]:
    (tmp_path / "turn.py").write_text(PROCEDURE)
    with simulated_servers(tmp_path / "bench.toml", "--speed", "5") as addresses:
        found = Lab(tmp_path, addresses)
        yield found
        found.close()


def _elsewhere(folder: Path) -> dict[str, str]:
    """The environment of cron, of systemd, of another login."""
    for name in ("tmp", "runtime", "home"):
        (folder / name).mkdir(exist_ok=True)
    kept = {name: value for name, value in os.environ.items() if name not in ("USER", "LOGNAME", "TEMP", "TMP")}
    return kept | {
        "TMPDIR": str(folder / "tmp"),
        "XDG_RUNTIME_DIR": str(folder / "runtime"),
        "HOME": str(folder / "home"),
        "LOGNAME": "somebody-else",
    }


def _ran(arguments: Sequence[str | Path], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(arguments, capture_output=True, text=True, timeout=150, env=_elsewhere(folder))


def test_a_stream_that_cannot_be_reached_ends_a_run_before_anything_is_commanded(lab: Lab) -> None:
    text = (lab.folder / "bench.toml").read_text(encoding="utf-8")
    with socket.create_server(("127.0.0.1", 0)) as once:
        nobody = f"tcp://127.0.0.1:{once.getsockname()[1]}"
    (lab.folder / "moved.toml").write_text(text.replace(lab.addresses["digitizer_stream"], nobody), encoding="utf-8")
    demand = lab.say(":dem:rate? 1")
    refused = _ran(lab.run_arguments("refused", "moved.toml"), lab.folder)
    assert refused.returncode == 3
    assert len(refused.stderr.splitlines()) == 1
    assert f"its stream: {nobody}: could not connect" in refused.stderr
    assert not (lab.folder / "refused").exists()
    assert lab.say(":dem:rate? 1") == demand
    with LabJackT7(lab.addresses["digitizer"], lab.addresses["digitizer_stream"], clock=ScaledClock()) as t7:
        t7.read_once()  # refused where a stream was left


@pytest.mark.slow
def test_a_second_run_in_another_environment_by_another_name_is_refused_and_the_first_one_goes_on(lab: Lab) -> None:
    with lab.running("first") as first:
        second = _ran(lab.run_arguments("second", "renamed.toml"), lab.folder)
        assert second.returncode == 3
        assert second.stderr.startswith("benchctl: rate_table at tcp://LocalHost:")
        assert f"is in use by process {first.pid} (campaign {lab.folder / 'first'}, since " in second.stderr
        assert second.stderr.count("\n") == 1
        assert not (lab.folder / "second").exists()
        assert float(lab.say(":dem:rate? 1")) == 60.0
        assert abs(float(lab.say(":read:rate? 1")) - 60.0) < 0.1
        checked = _ran(
            (sys.executable, "-m", "benchctl", "check", "static", "--bench", lab.folder / "renamed.toml"), lab.folder
        )
        assert (checked.returncode, "is in use by process" in checked.stderr) == (3, True)
        first.send_signal(signal.SIGINT)
        _, errors = first.communicate(timeout=60)
    assert "stopped by Ctrl-C" in errors
    journal = (lab.folder / "first" / "journal.jsonl").read_text(encoding="utf-8")
    assert '"kind": "motion"' not in journal
    assert '"kind": "gap"' not in journal
    lab.wait_for_rate(0.0)


@pytest.mark.slow
def test_a_run_that_no_lock_reaches_finds_the_bench_in_use_and_commands_nothing(lab: Lab) -> None:
    # what another machine is: the same instruments, and none of the locks
    (lab.folder / "locks").mkdir(mode=0o777)
    (lab.folder / "locks").chmod(0o1777)
    from_elsewhere = (
        "from pathlib import Path; import benchctl.campaign.reserved as r; "
        f"r.LOCK_PLACES = (Path({str(lab.folder / 'locks')!r}),); "
        "from benchctl.cli.app import run_verb; import sys; sys.exit(run_verb(sys.argv[1:]))"
    )
    with lab.running("first") as first:
        arguments = lab.run_arguments("second", "bench.toml")[3:]
        second = _ran((sys.executable, "-c", from_elsewhere, *arguments), lab.folder)
        assert second.returncode == 3, second.stderr
        assert re.search(r"rate_table: turns at \+(59\.9|60\.0)\d+ deg/s before this run", second.stderr)
        assert second.stderr.count("\n") == 1
        assert not (lab.folder / "second").exists()
        checked = _ran(
            (sys.executable, "-c", from_elsewhere, "check", "static", "--bench", lab.folder / "bench.toml"), lab.folder
        )
        assert checked.returncode == 0, checked.stderr
        assert float(lab.say(":dem:rate? 1")) == 60.0
        first.send_signal(signal.SIGINT)
        first.communicate(timeout=60)
    journal = (lab.folder / "first" / "journal.jsonl").read_text(encoding="utf-8")
    assert '"kind": "motion"' not in journal
    assert '"kind": "gap"' not in journal


@pytest.mark.slow
def test_after_a_run_was_killed_together_with_its_guard_the_next_one_ends_its_stream(lab: Lab) -> None:
    with lab.running("killed") as run:
        children = Path(f"/proc/{run.pid}/task/{run.pid}/children")
        guards = [int(pid) for pid in children.read_text().split()] if children.exists() else []
        for guard in guards:
            os.kill(guard, signal.SIGKILL)
        run.kill()
        run.wait()
    if not guards:
        pytest.skip("this system does not name the children of a process")
    refused = _ran(lab.run_arguments("second", "bench.toml"), lab.folder)
    assert refused.returncode == 3
    assert "left in motion" in refused.stderr  # nobody stopped the table: a person has to look
    lab.say(":dem:rate 1,0")
    lab.wait_for_rate(0.0)
    again = _ran(lab.run_arguments("third", "bench.toml", "-p", "duration_s=20"), lab.folder)
    assert again.returncode == 0, again.stderr


def test_a_digitizer_that_streams_for_another_machine_is_left_alone_and_the_table_not_commanded(lab: Lab) -> None:
    digitizer = LabJackT7(lab.addresses["digitizer"], lab.addresses["digitizer_stream"], clock=ScaledClock(5.0))
    with digitizer:
        digitizer.start_stream(100.0)
        demand = lab.say(":dem:rate? 1")
        refused = _ran(lab.run_arguments("second", "bench.toml"), lab.folder)
        assert (refused.returncode, refused.stderr.count("\n")) == (3, 1)
        assert "a stream runs that this program did not start" in refused.stderr
        assert (lab.say(":dem:rate? 1"), lab.say(":mode? 1")) == (demand, "Off")
        assert len(digitizer.read_stream(100, 10.0).gyro_v) >= 100
