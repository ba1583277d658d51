"""Programs that others wrote for real Thermotron controllers, against the simulated ones.

PyMeasure's client runs as it is installed. Of clients that are no packages the dialogue is reproduced: what they send,
and what they need for an answer.
"""

from __future__ import annotations

import socket
import sys
from typing import Any

import pytest

from benchctl_instruments.links.address import parse_address
from benchctl_instruments.simulated.thermotron_3800 import SimulatedThermotron3800
from benchctl_instruments.simulated.thermotron_8800 import SimulatedThermotron8800
from tests.instruments.chamber_machine import FakeChamber


@pytest.fixture
def machine() -> FakeChamber:
    chamber = FakeChamber()
    chamber.air, chamber.setpoint = -12.5, 20.0
    return chamber


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
@pytest.mark.foreign_client("thermotron_3800", "PyMeasure Thermotron3800", "sets, runs, stops", package="pymeasure")
def test_pymeasures_3800_sets_runs_and_stops_the_chamber(machine: FakeChamber, monkeypatch: pytest.MonkeyPatch) -> None:
    """It waits a second after each command, which the simulated chamber does not need."""
    adapters = pytest.importorskip("pymeasure.adapters", reason="PyMeasure is not installed: pip install pymeasure")
    client: Any = pytest.importorskip("pymeasure.instruments.thermotron.thermotron3800")
    monkeypatch.setattr(client, "sleep", lambda seconds: None)
    with SimulatedThermotron3800(machine) as twin:
        port = twin.address.removeprefix("serial://").partition("?")[0]
        adapter = adapters.SerialAdapter(
            port, baudrate=9600, timeout=5.0, write_termination="\r\n", read_termination="\r\n"
        )
        oven = client.Thermotron3800(adapter)
        modes = oven.Thermotron3800Mode
        assert (oven.id, oven.temperature, oven.setpoint) == ("3800 SIMULATED", -12.5, 20.0)
        assert oven.mode == modes.EDIT_MODE_STOP
        oven.setpoint = -40
        assert oven.setpoint == 20.0  # "will not update until the run() command is called"
        oven.run()
        assert (oven.setpoint, machine.setpoint, machine.on, oven.mode) == (-40.0, -40.0, True, modes.MANUAL_MODE)
        oven.setpoint = 60
        assert machine.setpoint == -40.0
        oven.run()
        assert oven.setpoint == machine.setpoint == 60.0
        oven.stop()
        assert (oven.mode, machine.on) == (modes.EDIT_MODE_STOP, False)
        oven.run()
        oven.initalize_oven()
        assert oven.mode == modes.EDIT_MODE_STOP
        adapter.close()


@pytest.mark.foreign_client("thermotron_8800", "three public programs", "sets, runs, ramps, stops, alarms")
@pytest.mark.parametrize("end", [b"\r", b"\n", b"\r\n"])
def test_three_programs_for_an_8800_get_its_answers(machine: FakeChamber, end: bytes) -> None:
    """One ends its lines with CR, one with LF and one as its settings say; two look at the 0 of a command."""
    machine.power = 37.5
    dialogue = (
        (b"IDEN?", b"8800 SIMULATED"),
        (b"PVAR1?", b"-12.500"),
        (b"SCOD?", b"0"),
        (b"ALRM1?", b"0"),
        (b"SETP1,30", b"0"),
        (b"SETP1?", b"20.000"),  # "must be sent a RUNM command before it loads the setpoint into the register"
        (b"RUNM", b"0"),
        (b"SETP1?", b"30.000"),
        (b"SCOD?", b"1"),
        (b"SETP1,-40.250000", b"0"),
        (b"SETP1?", b"-40.250"),
        (b"MRMP1,2.5", b"0"),
        (b"MRMP1?", b"2.500"),
        (b"THTL1?", b"37.500"),
        (b"SETP1,200", b"1"),
        (b"FOO", b"1"),
        (b"STOP", b"0"),
        (b"SCOD?", b"5"),  # "Computer interface. The 8800 received the stop command."
    )
    with SimulatedThermotron8800(machine) as twin:
        address = parse_address(twin.address)
        with socket.create_connection((address.host, address.port), timeout=5.0) as line, line.makefile("rb") as heard:
            for request, answer in dialogue:
                line.sendall(request + end)
                assert heard.readline() == answer + b"\r\n", request
    assert (machine.setpoint, machine.on) == (-40.25, False)
