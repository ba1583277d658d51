"""Ctrl-C, SIGTERM, SIGHUP while table and chamber are under way, over real wires, the bench asked by somebody else."""

import json
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchctl.recordings.reader import open_recording
from tests.benchctl.cli.foreign_eyes import ForeignEyes
from tests.benchctl.cli.processes import simulated_servers, started

PROCEDURE = """
from benchctl.plan import Static, ThermalRamp, procedure

@procedure()
def swing():
    '''A swing while the chamber ramps.'''
    yield Static(duration_s=5.0)
    yield ThermalRamp(from_c=23.0, to_c=80.0, ramp_c_per_min=2.0, swing_dps=150.0, swing_hz=0.5, settle_s=4.0)
"""
SPEED = "50"

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGTERM to send to another process")


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, ForeignEyes]]:
    """A bench.toml that reaches a bench served by another process, and somebody who looks at it."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "swing.py").write_text(PROCEDURE)
    with simulated_servers(folder / "bench.toml", "--speed", SPEED) as addresses, ForeignEyes(addresses) as eyes:
        yield folder, eyes


@pytest.fixture(autouse=True)
def _as_from_a_terminal() -> Iterator[None]:
    """Under nohup a program inherits that SIGHUP is ignored; the runs here are to hear it."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize(
    ("number", "times"),
    [
        pytest.param(signal.SIGINT, 1, id="Ctrl-C", marks=pytest.mark.slow),
        pytest.param(signal.SIGINT, 4, id="Ctrl-C again and again"),
        pytest.param(signal.SIGTERM, 1, id="SIGTERM", marks=pytest.mark.slow),
        pytest.param(signal.SIGHUP, 2, id="SIGHUP", marks=pytest.mark.slow),
    ],
)
def test_a_signal_in_a_swing_at_temperature_leaves_the_bench_at_rest_and_an_honest_recording_within_five_seconds(
    lab: tuple[Path, ForeignEyes], tmp_path: Path, number: signal.Signals, times: int
) -> None:
    folder, eyes = lab
    campaign, result = tmp_path / "campaign", tmp_path / "result.json"
    with started(
        "run", folder / "swing.py", "--bench", folder / "bench.toml", "--out", campaign, "--json", result
    ) as process:
        eyes.wait_for_swing(process)
        eyes.wait_for_chamber(23.5, process)
        time.sleep(1.0)
        asked_s = time.monotonic()
        for _ in range(times):
            process.send_signal(number)
            time.sleep(0.05)
        _, errors = process.communicate(timeout=20)
        took_s = time.monotonic() - asked_s
        assert process.returncode == 3
        assert took_s < 5.0
        assert abs(eyes.rate_dps()) < 0.05
        assert eyes.chamber_setpoint_c() == pytest.approx(23.0)
    says = "Ctrl-C" if number == signal.SIGINT else number.name
    assert errors.strip().splitlines()[-1] == f"benchctl: stopped by {says}"
    document = json.loads(result.read_text())
    assert (document["ok"], document["status"], document["steps"]) == (False, "interrupted", {"planned": 2, "whole": 1})
    with open_recording(campaign) as recording:
        assert recording.meta.status == "interrupted"
        assert [info.whole for info in recording.infos] == [True, False]
        assert recording.infos[1].samples > 1000
