"""Programs that others wrote for real Weiss and Vötsch chambers, against the simulated ones.

basil's LabEvent runs as it is installed. Of clients that are no packages the dialogue is reproduced: what they send,
and what they need for an answer.
"""

from __future__ import annotations

import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import serial

from benchctl_instruments.links.address import parse_address
from benchctl_instruments.simulated.weiss_ascii2 import SimulatedWeissAscii2
from benchctl_instruments.simulated.weiss_simserv import SimulatedWeissSimserv
from tests.instruments.chamber_machine import FakeChamber

needs_terminals = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")


@pytest.fixture
def machine() -> FakeChamber:
    chamber = FakeChamber()
    chamber.air, chamber.setpoint = -12.5, 20.0
    return chamber


@contextmanager
def connected(served: str) -> Iterator[socket.socket]:
    address = parse_address(served)
    with socket.create_connection((address.host, address.port), timeout=5.0) as connection:
        yield connection


# SIMSERV --------------------------------------------------------------------------------------------------------------


@pytest.mark.foreign_client("weiss_simserv", "basil weiss_labevent", "reads, sets, starts, stops", package="basil-daq")
def test_basils_labevent_reads_sets_starts_and_stops_the_chamber(machine: FakeChamber) -> None:
    dut = pytest.importorskip("basil.dut", reason="basil is not installed: pip install basil-daq")
    with SimulatedWeissSimserv(machine) as twin:
        address = parse_address(twin.address)
        line = {"address": address.host, "port": address.port, "write_termination": "\\r", "read_termination": "\\r\\n"}
        bench = dut.Dut(
            {
                "transfer_layer": [{"name": "eth", "type": "Socket", "init": line}],
                "hw_drivers": [{"name": "chamber", "type": "weiss_labevent", "interface": "eth"}],
            }
        )
        bench.init()
        chamber = bench["chamber"]
        assert (chamber.get_info(), chamber.get_status()) == ("LabEvent T/210/70/5", "1: Test not running (Idle)")
        assert (chamber.get_temperature(), chamber.get_temperature_setpoint()) == (-12.5, 20.0)
        chamber.set_temperature(-40.0)
        assert chamber.get_temperature_setpoint() == machine.setpoint == -40.0
        chamber.start_manual_mode()
        assert (machine.on, chamber.get_status()) == (True, "3: Test running")
        chamber.set_air_dryer(True)
        chamber.set_compressed_air(False)
        assert (chamber.get_air_dryer(), chamber.get_compressed_air(), machine.on) == (True, False, True)
        chamber.stop_manual_mode()
        assert not machine.on
        bench.close()


@pytest.mark.foreign_client("weiss_simserv", "IzaakWN/ClimateChamberMonitor", "reads, sets, starts, stops, alarms")
def test_a_laboratorys_monitor_of_its_climate_chamber_gets_its_answers(machine: FakeChamber) -> None:
    """IzaakWN/ClimateChamberMonitor and the Python package for Vötsch chambers: bytes sent, bytes needed."""
    with SimulatedWeissSimserv(machine) as twin, connected(twin.address) as line:

        def ask(command: bytes) -> bytes:
            line.send(command)
            return line.recv(512)  # both read once, at most 512 bytes

        assert ask(b"99997\xb61\xb61\r") == b"1\xb6LabEvent T/210/70/5\r\n"  # test_system_type
        assert ask(b"99997\xb61\xb63\r") == b"1\xb6SIMULATED\r\n"  # serial_number
        assert ask(b"11004\xb61\xb61\r") == b"1\xb6-12.5\r\n"  # temperature_measured
        assert ask(b"11001\xb61\xb61\xb624\r") == b"1\r\n"  # forceWarmUp: set point, gradients, air, dryer, start
        assert ask(b"11068\xb61\xb61\xb63\r") == b"1\r\n"
        assert ask(b"11072\xb61\xb61\xb63\r") == b"1\r\n"
        assert ask(b"11066\xb61\xb61\r") == b"1\xb63.0\r\n"
        assert ask(b"14001\xb61\xb67\xb61\r") == b"1\r\n"
        assert ask(b"14003\xb61\xb67\r") == b"1\xb61\r\n"
        assert ask(b"14001\xb61\xb61\xb61\r") == b"1\r\n"
        assert (machine.setpoint, machine.on) == (24.0, True)
        assert ask(b"10012\xb61\r") == b"1\xb63\r\n"
        assert ask(b"11018\xb61\r") == b"1\xb61\r\n"
        assert ask(b"11023\xb61\xb61\r") == b"1\xb6\xb0C\r\n"
        twin.controller.active = {1, 2}
        assert ask(b"10012\xb61\r") == b"1\xb615\r\n"  # +4 warnings, +8 alarms
        assert ask(b"17002\xb61\r") == b"1\xb63\r\n"  # getActiveWarnings
        assert [ask(b"17009\xb61\xb6%d\r" % index) for index in (1, 3)] == [b"1\xb61\r\n", b"1\xb60\r\n"]
        assert ask(b"17005\xb61\xb61\r") == b"1\xb61\r\n"
        assert ask(b"17007\xb61\xb61\r") == b"1\xb6Temperature beyond its limits\r\n"
        assert ask(b"17012\xb61\r") == b"1\r\n"  # reset all errors
        assert ask(b"10012\xb61\r") == b"1\xb63\r\n"
        assert ask(b"19210\xb61\r") == b"1\xb60\r\n"  # stopClimateChamber
        assert ask(b"14001\xb61\xb61\xb60\r") == b"1\r\n"
        assert not machine.on


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (b"12345\xb61\r", b"-5\r\n"),  # no such command
        (b"hello\r", b"-5\r\n"),
        (b"11001\xb61\xb61\r", b"-6\r\n"),  # a parameter is missing
        (b"11001\xb61\xb61\xb6warm\r", b"-6\r\n"),
        (b"11001\xb61\xb61\xb6200.0\r", b"-6\r\n"),
        (b"11004\xb61\xb69\r", b"-8\r\n"),  # no such variable
    ],
)
def test_what_simserv_refuses_has_the_code_of_the_makers_manual(
    machine: FakeChamber, command: bytes, answer: bytes
) -> None:
    with SimulatedWeissSimserv(machine) as twin, connected(twin.address) as line:
        line.send(command)
        assert line.recv(512) == answer
    assert machine.setpoint == 20.0


# ASCII-2 --------------------------------------------------------------------------------------------------------------


@needs_terminals
@pytest.mark.foreign_client("weiss_ascii2", "ondrejh/VT4002", "sets, starts, stops, reads")
def test_two_programs_for_a_vt4002_set_and_read_it_on_its_serial_line(machine: FakeChamber) -> None:
    """ondrejh/VT4002 reads lines until 0.5 s pass without one, and the second value; Embida/pyVT4002 reads one line."""
    with (
        SimulatedWeissAscii2(machine) as twin,
        serial.Serial(twin.address.removeprefix("serial://").partition("?")[0], 9600, timeout=0.5) as port,
    ):
        port.write(b"$01E 0035.0 0080.0 0027.5 0000.0 0027.0 -191.3 0000.0 -191.3 0025.5 -191.3 0111000000000000\r\n")
        assert port.readlines() == [b"0\r\n"]
        assert (machine.setpoint, machine.on) == (35.0, True)
        port.write(b"$01I\r\n")
        first, second, *_, channels = port.readlines()[-1].decode("ascii").split(" ")
        assert (float(first), float(second), channels[1]) == (35.0, -12.5, "1")
        port.write(b"$01E -020.0\r\n")  # "this will stop the air conditioning"
        assert port.readlines() == [b"0\r\n"]
        assert (machine.setpoint, machine.on) == (-20.0, False)
        port.write(b"$01E 0040.0 0050.0 0050.0\r\n")
        assert port.readline() == b"0\r\n"
        port.write(b"$00I\r\n")  # another chamber's address
        assert port.readline() == b""
    assert machine.setpoint == 40.0


@needs_terminals
@pytest.mark.foreign_client("weiss_ascii2", "pyVT4002", "reads and sets", package="pyvt4002")
def test_pyvt4002_reads_and_sets_the_chamber(machine: FakeChamber) -> None:
    published = pytest.importorskip("VT4002", reason="pyVT4002 is not installed: pip install pyvt4002")
    with SimulatedWeissAscii2(machine) as twin:
        port = twin.address.removeprefix("serial://").partition("?")[0]
        chamber = published.Connection(port, chamber_address="01")
        values = chamber.get_actual_values()
        assert (values.temp1_nominal(), values.temp1_actual()) == (20.0, -12.5)
        chamber.set_nominal_values(nominal_value_1=45.5)
        assert chamber.get_actual_values().temp1_nominal() == machine.setpoint == 45.5
        chamber.ser.close()


def test_a_program_for_a_wt120_starts_and_stops_it_over_tcp(machine: FakeChamber) -> None:
    """Its answers end with CR; between value and channels it sends two blanks, and one before the end."""
    with (
        SimulatedWeissAscii2(machine, over_tcp=True) as twin,
        connected(twin.address) as line,
        line.makefile("rb") as heard,
    ):
        for request, answer in (
            (b"$01E 55.500000 010000 \r", b"0"),
            (b"$01I\r", b"0055.5 -012.5 "),
            (b"$01E 0020.0 000000 \r", b"0"),
        ):
            line.sendall(request)
            assert heard.readline().startswith(answer)
        line.sendall(b"$01?\r")
        assert heard.readline() == b"ASCII-2 PROTOCOL CONFIGURATION\r\n"
    assert (machine.setpoint, machine.on, machine.switched) == (20.0, False, 2)
