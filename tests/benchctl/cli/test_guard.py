"""The runner is killed, stopped, or hangs: its guard brings the bench to rest, and somebody else looks at it."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from pymodbus import FramerType
from pymodbus.client import ModbusSerialClient

from benchctl.bench import template
from tests.benchctl.cli.foreign_eyes import ForeignEyes
from tests.benchctl.cli.processes import simulated_servers, started
from tests.benchctl.receiver import receiving
from tests.waiting import wait_until

PROCEDURE = """
from benchctl.plan import ThermalRamp, procedure

@procedure()
def swing(to_c: float = 80.0):
    '''A swing while the chamber ramps.'''
    yield ThermalRamp(from_c=23.0, to_c=to_c, ramp_c_per_min=2.0, swing_dps=150.0, swing_hz=0.5, settle_s=4.0)
"""

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no kill -9 and no SIGSTOP")


@dataclass
class Lab:
    """A simulated bench that other processes serve."""

    folder: Path
    eyes: ForeignEyes
    serial_chamber: bool = False  # which no eyes can ask while the run has its port

    @contextmanager
    def running(self, name: str, *arguments: str, bench: str = "bench.toml") -> Iterator[subprocess.Popen[str]]:
        """A run on it, with the table in full swing and the chamber on its way."""
        self.campaign = self.folder / name
        with started(
            "run", self.folder / "swing.py", "--bench", self.folder / bench, "--out", self.campaign, *arguments
        ) as runner:
            self.eyes.wait_for_swing(runner)
            if self.serial_chamber:
                wait_until(lambda: any((self.campaign / "steps").glob("0001_*")), 10.0, "the stream never began")
            else:
                self.eyes.wait_for_chamber(23.5, runner)
            yield runner

    def events(self, kind: str) -> list[dict[str, Any]]:
        lines = (self.campaign / "journal.jsonl").read_text(encoding="utf-8").splitlines()
        return [event for event in map(json.loads, lines) if event["kind"] == kind]

    def wait_for_guard(self) -> dict[str, Any]:
        """The guard's last word."""
        wait_until(lambda: "reason" in self.events("guard")[-1], 10.0, "the guard said nothing")
        return self.events("guard")[-1]

    def guard_pid(self) -> int:
        """The process that guards the run now, by the journal."""
        return int(re.findall(r"process (\d+)", self.events("guard")[-1]["says"])[-1])


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    folder = tmp_path_factory.mktemp("lab")
    (folder / "swing.py").write_text(PROCEDURE)
    with simulated_servers(folder / "bench.toml", "--speed", "50") as addresses, ForeignEyes(addresses) as eyes:
        impatient = tomllib.loads((folder / "bench.toml").read_text(encoding="utf-8"))
        impatient["limits"]["silence_s"], impatient["safe"]["hang_s"] = 1.0, 3.0
        (folder / "impatient.toml").write_text(tomli_w.dumps(impatient), encoding="utf-8")
        yield Lab(folder, eyes)


def test_after_kill_9_the_table_rests_and_the_chamber_is_sent_home_within_five_seconds_and_the_journal_says_why(
    lab: Lab,
) -> None:
    with lab.running("killed") as runner:
        runner.kill()
        assert lab.eyes.wait_for_rest(23.0, timeout_s=5.0) < 5.0
        event = lab.wait_for_guard()
        assert event["reason"] == f"the runner ended without saying that the bench is at rest (process {runner.pid})"
        assert abs(event["rate_dps"]) < 0.05
        assert (event["chamber_setpoint_c"], event["problems"]) == (23.0, [])
        _, errors = runner.communicate(timeout=10)
    assert errors.startswith("benchctl guard: the runner ended without saying")
    assert re.search(r"; table at rest \([+-]0\.0\d+ deg/s\) and chamber set to 23 °C, read back$", errors.strip())


@pytest.mark.slow
def test_its_guard_also_sends_a_message_and_the_journal_holds_no_secret(lab: Lab) -> None:
    with receiving() as (port, received):
        bench = tomllib.loads((lab.folder / "bench.toml").read_text(encoding="utf-8"))
        bench["notify"] = {"urls": [f"json://127.0.0.1:{port}/s3cret", "json://127.0.0.1:9/s3cret"]}
        (lab.folder / "notify.toml").write_text(tomli_w.dumps(bench), encoding="utf-8")
        with lab.running("notified", bench="notify.toml") as runner:
            runner.kill()
            _, errors = runner.communicate(timeout=30)  # to the end of stderr, which the guard has too
    ((title, text),) = received
    assert title == "guard: notified"
    assert text.startswith(
        f"the runner ended without saying that the bench is at rest (process {runner.pid}); table at"
    )
    assert text.endswith(f"read back\n{lab.campaign}")
    said, missed = errors.splitlines()
    assert said.startswith("benchctl guard: the runner ended without saying")
    assert missed.startswith("benchctl guard: no message to json://…: ")
    assert lab.events("guard")[-1]["says"] == missed.removeprefix("benchctl guard: ")
    assert [path for path in lab.campaign.rglob("*.*") if b"s3cret" in path.read_bytes()] == []


@pytest.mark.slow
def test_a_runner_that_hangs_is_killed_by_its_guard_which_then_brings_the_bench_to_rest(lab: Lab) -> None:
    with lab.running("hung", bench="impatient.toml") as runner:
        runner.send_signal(signal.SIGSTOP)
        lab.eyes.wait_for_rest(23.0, timeout_s=3.0 + 5.0)
        assert runner.wait(timeout=5) == -signal.SIGKILL
        assert lab.wait_for_guard()["reason"] == f"the runner hangs (process {runner.pid}), and was killed"


@pytest.mark.slow
@pytest.mark.parametrize("later_s", [0.0, 0.02, 0.05, 0.1])
def test_a_runner_that_is_killed_while_it_brings_the_bench_to_rest_needs_no_luck(lab: Lab, later_s: float) -> None:
    with lab.running(f"stopped_{later_s:g}") as runner:
        runner.send_signal(signal.SIGINT)
        time.sleep(later_s)
        runner.kill()
        lab.eyes.wait_for_rest(23.0, timeout_s=5.0)
        time.sleep(0.3)
        assert abs(lab.eyes.rate_dps()) < 0.05


@pytest.mark.slow
def test_a_guard_is_deaf_to_signals_and_one_that_is_killed_is_replaced_while_the_run_goes_on(lab: Lab) -> None:
    with lab.running("guards") as runner:
        first = lab.guard_pid()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            os.kill(first, number)
        time.sleep(1.0)
        assert lab.guard_pid() == first
        os.kill(first, signal.SIGKILL)
        wait_until(lambda: lab.guard_pid() != first, 10.0, "no other guard was started")
        second = lab.guard_pid()
        assert lab.events("guard")[-1]["says"] == (
            f"process {first} ended (exit status -9); process {second} takes its place"
        )
        lab.eyes.wait_for_swing(runner)
        runner.kill()
        lab.eyes.wait_for_rest(23.0, timeout_s=5.0)
        lab.wait_for_guard()


@pytest.mark.slow
def test_a_run_that_ends_in_order_leaves_no_guard_behind_and_no_word_of_it(lab: Lab) -> None:
    with lab.running("whole", "-p", "to_c=27") as runner:
        _, errors = runner.communicate(timeout=30)  # to the end of stderr, which the guard has too
    assert (runner.returncode, errors) == (0, "")
    assert len(lab.events("guard")) == 1


@pytest.mark.slow
def test_a_serial_port_that_only_one_process_may_have_is_taken_over(tmp_path: Path) -> None:
    (tmp_path / "sim.toml").write_text(template().replace('"watlow_f4t"', '"watlow_f4"'))
    (tmp_path / "swing.py").write_text(PROCEDURE)
    with started(
        "sim", "--bench", tmp_path / "sim.toml", "--write-bench", tmp_path / "bench.toml", "--speed", "50"
    ) as sim:
        assert sim.stdout is not None
        addresses = json.loads(sim.stdout.readline())
        port = addresses["chamber"].removeprefix("serial://").partition("?")[0]
        with ForeignEyes(addresses | {"chamber": addresses["digitizer"]}) as eyes:
            lab = Lab(tmp_path, eyes, serial_chamber=True)
            with lab.running("serial") as runner:
                runner.kill()
                event = lab.wait_for_guard()
            assert (event["chamber_setpoint_c"], event["problems"]) == (23.0, [])
            assert abs(eyes.rate_dps()) < 0.05
            with ModbusSerialClient(port, framer=FramerType.RTU, baudrate=19200) as client:
                assert client.read_holding_registers(300, count=1, device_id=1).registers == [230]
