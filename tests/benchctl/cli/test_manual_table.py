"""A manual table as a user has it: what `check` and `doctor` state, and a run whose operator turns a knob elsewhere."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchctl.bench import template
from benchctl.recordings.reader import open_recording
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.manual import SimulatedManualTable
from benchctl_instruments.simulated.world import World
from tests.benchctl.campaign.by_hand import done
from tests.benchctl.cli.processes import started, without_a_process

NOBODY = "rate_table: it is operated manually: only the operator can stop it"
SETTINGS = ("at_c=23", "soak_s=60", "top_rate_dps=40", "rates=1", "run_s=4", "zero_s=3", "verify=false")
SWEEP = ("rate_sweep", *(f"-p{setting}" for setting in SETTINGS))


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    path = tmp_path / "bench.toml"
    path.write_text(template().replace('"acutrol3000"', '"manual"', 1), encoding="utf-8")
    return path


def test_check_states_that_nobody_else_can_stop_the_table_and_lists_the_questions(bench: Path) -> None:
    checked = without_a_process("check", *SWEEP, "--bench", bench)
    assert checked.returncode == 0
    assert f"warning: {NOBODY}; after an error or Ctrl-C a run and its guard only request a stop" in checked.stdout
    assert '"stop the table" = "done"' in checked.stdout
    assert "rate_table: manual: set by an operator, measured by the encoder" in " ".join(checked.stdout.split())


def test_check_refuses_swings_in_one_line(bench: Path) -> None:
    checked = without_a_process("check", "sine_sweep", "--bench", bench)
    assert checked.returncode == 2
    assert "swings, and the bench's table, manual, has no sinusoid" in checked.stderr


def test_doctor_tries_no_wire_of_a_manual_table(bench: Path, tmp_path: Path) -> None:
    simulated = without_a_process("doctor", "--bench", bench, "--out", tmp_path)
    assert "simulated; has no wire: manual: set by an operator" in simulated.stdout
    real = template().replace("simulated = true", "simulated = false").replace('"acutrol3000"', '"manual"', 1)
    for model in ("watlow_f4t", "labjack_t7"):
        real = real.replace(f'model = "{model}"', f'model = "{model}"\naddress = "tcp://127.0.0.1:1"', 1)
    bench.write_text(real, encoding="utf-8")
    examined = without_a_process("doctor", "--bench", bench, "--out", tmp_path)
    assert NOBODY in " ".join(examined.stdout.split())
    assert examined.returncode == 3  # of the others: nothing listens there


def test_a_knob_takes_rates_and_refuses_other_lines() -> None:
    clock = VirtualClock()
    world = World(clock)
    with SimulatedManualTable(world.table) as knob:
        assert _tell(knob.address, b"+2") + _tell(knob.address, b"fast\nnan\n-20\n") == (
            b"expected a rate in deg/s, such as +20\n" * 2 + b"-20 deg/s\n"
        )
    clock.sleep(5.0)
    assert world.table.motion().rate_dps == pytest.approx(-20.0, abs=0.1)


def _tell(address: str, lines: bytes) -> bytes:
    host, _, port = address.removeprefix("tcp://").partition(":")
    with socket.create_connection((host, int(port)), timeout=20) as knob:
        knob.sendall(lines)
        knob.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: knob.recv(4096), b""))


@pytest.mark.slow
def test_a_run_goes_on_as_somebody_turns_the_knob_of_the_served_table(bench: Path, tmp_path: Path) -> None:
    turns = [f"set the table to {rate} and wait until it turns steadily" for rate in _RATES]
    (tmp_path / "answers.toml").write_text(
        "\n".join(f'{json.dumps(says)} = "done"' for says in [*turns, "stop the table"])
    )
    with started("sim", "--bench", bench, "--speed", "10", "--write-bench", tmp_path / "sim.toml") as servers:
        assert servers.stdout is not None
        knob = json.loads(servers.stdout.readline())["rate_table"]
        arguments = (*SWEEP, "--bench", "sim.toml", "--answers", "answers.toml", "--out", "c")
        with subprocess.Popen(
            [sys.executable, "-m", "benchctl", "run", *arguments],
            cwd=tmp_path,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        ) as run:
            assert run.stderr is not None
            said = []
            for line in run.stderr:
                said.append(line)
                if (rate := re.match(r"benchctl: set the table to (\S+)", line)) is not None:
                    _tell(knob, f"{1.04 * float(rate[1])}\n".encode())
                elif line.startswith("benchctl: stop the table"):
                    _tell(knob, b"0\n")
        assert run.returncode == 0, said
    assert said[0].startswith(f"benchctl: warning: {NOBODY}")
    assert done(tmp_path / "c") == [*turns, "stop the table"]
    with open_recording(tmp_path / "c") as recording:
        for step in recording.steps():
            if step.info.rate_dps:
                shown = np.polyfit(step["time_s"], np.unwrap(step["encoder_deg"], period=360.0), 1)[0]
                assert shown == pytest.approx(1.04 * step.info.rate_dps, rel=1e-3)


_RATES = ("+40 deg/s (counter-clockwise from above)", "-40 deg/s (clockwise from above)")
