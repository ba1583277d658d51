"""Ctrl-C and SIGTERM in the middle of a sine at temperature, over real wires, the bench asked by somebody else."""

import json
import signal
import socket
import sys
import time
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

import pytest
from pymodbus.client import ModbusTcpClient

from benchctl.recordings.reader import open_recording
from tests.benchctl.cli.processes import simulated_servers, started

PROCEDURE = """
from benchctl.plan import Sine, Soak, procedure

@procedure()
def swing():
    '''A long sine at temperature.'''
    yield Soak(setpoint_c=26.0, hold_s=30.0, tolerance_c=0.5, drift_c_per_min=5.0)
    yield Sine(amplitude_dps=150.0, frequency_hz=0.5, cycles=100000)
"""
SPEED = "200"
F4T_SET_POINT = 2782

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGTERM to send to another process")


class ForeignEyes:
    """Asks the simulated instruments over connections of its own, with nothing of ours but the addresses."""

    def __init__(self, addresses: dict[str, str]) -> None:
        table, chamber = urlsplit(addresses["rate_table"]), urlsplit(addresses["chamber"])
        self._table = socket.create_connection((table.hostname, table.port), timeout=5)
        self._replies = self._table.makefile("rb")
        self._chamber = ModbusTcpClient(str(chamber.hostname), port=int(chamber.port or 0))
        self._chamber.connect()

    def rate_dps(self) -> float:
        self._table.sendall(b":read:rate? 1\r\n")
        return float(self._replies.readline()[8:])

    def chamber_setpoint_c(self) -> float:
        registers = self._chamber.read_holding_registers(F4T_SET_POINT, count=2, device_id=1).registers
        return float(
            self._chamber.convert_from_registers(registers, self._chamber.DATATYPE.FLOAT32, word_order="little")
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self._replies.close()
        self._table.close()
        self._chamber.close()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_a_sine_at_temperature_leaves_the_bench_at_rest_and_an_honest_recording_within_five_seconds(
    tmp_path: Path, number: signal.Signals
) -> None:
    (tmp_path / "swing.py").write_text(PROCEDURE)
    campaign, result = tmp_path / "campaign", tmp_path / "result.json"
    with (
        simulated_servers(tmp_path / "bench.toml", "--speed", SPEED) as addresses,
        ForeignEyes(addresses) as eyes,
        started(
            "run", tmp_path / "swing.py", "--bench", tmp_path / "bench.toml", "--out", campaign, "--json", result
        ) as process,
    ):
        deadline_s = time.monotonic() + 30
        while abs(eyes.rate_dps()) < 100.0:
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < deadline_s, "the table never swung"
            time.sleep(0.02)
        assert eyes.chamber_setpoint_c() == pytest.approx(26.0)
        time.sleep(1.5)
        process.send_signal(number)
        asked_s = time.monotonic()
        _, errors = process.communicate(timeout=20)
        took_s = time.monotonic() - asked_s
        assert process.returncode == 3
        assert took_s < 5.0
        assert abs(eyes.rate_dps()) < 0.05
        assert eyes.chamber_setpoint_c() == pytest.approx(23.0)
    says = "Ctrl-C" if number == signal.SIGINT else "SIGTERM"
    assert errors.strip().splitlines()[-1] == f"benchctl: stopped by {says}"
    document = json.loads(result.read_text())
    assert (document["ok"], document["status"], document["steps"]) == (False, "interrupted", {"planned": 2, "whole": 1})
    with open_recording(campaign) as recording:
        assert recording.meta.status == "interrupted"
        assert [info.whole for info in recording.infos] == [True, False]
        assert recording.infos[1].samples > 1000
