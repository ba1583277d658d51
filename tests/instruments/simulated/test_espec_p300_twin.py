"""The simulated P-300 byte for byte, as somebody at a terminal sees it."""

from __future__ import annotations

import socket
import sys
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.protocols.p300 import read_alarms, read_heater, read_mode, read_temperatures, read_type
from benchctl_instruments.simulated.espec_p300 import P300Controller, SimulatedEspecP300
from benchctl_instruments.simulated.serial_line import line_conversation
from tests.instruments.chamber_machine import FakeChamber


@pytest.fixture
def machine() -> FakeChamber:
    return FakeChamber()


@pytest.fixture
def controller(machine: FakeChamber) -> P300Controller:
    return P300Controller(machine)


@pytest.fixture
def twin(machine: FakeChamber) -> Iterator[SimulatedEspecP300]:
    with SimulatedEspecP300(machine) as twin:
        yield twin


def typed(address: str, data: bytes, lines: int) -> bytes:
    """What a raw socket gets back for bytes that were typed into it."""
    host, _, port = address.removeprefix("tcp://").rpartition(":")
    with socket.create_connection((host, int(port)), timeout=5.0) as terminal:
        terminal.sendall(data)
        heard = b""
        while heard.count(b"\r\n") < lines:
            heard += terminal.recv(4096)
    return heard


def test_a_session_at_a_terminal_over_tcp(twin: SimulatedEspecP300, machine: FakeChamber) -> None:
    machine.air, machine.power = 23.04, 12.34
    session = (
        b"TEMP?\r\nTEMP, S-40.0\r\nMODE,CONSTANT\r\nMON?\r\nMODE?,DETAIL\r\n%?\r\nALARM?\r\nTYPE?\r\nROM?\r\nSRQ?\r\n"
    )
    assert typed(twin.address, session, 10) == (
        b"23.0,20.0,180.0,-75.0\r\nOK:TEMP,S-40.0\r\nOK:MODE,CONSTANT\r\n23.0,,CONSTANT,0\r\nCONSTANT\r\n1,12.3\r\n0\r\n"
        b"T,P300,180.0\r\nP300 SIMULATED 1.00\r\n00000000\r\n"
    )
    assert (machine.setpoint, machine.on) == (-40.0, True)


@pytest.mark.parametrize("end", [b"\r\n", b"\n", b"\r"])
def test_lines_may_end_as_the_terminal_ends_them(twin: SimulatedEspecP300, end: bytes) -> None:
    assert typed(twin.address, b"mode?" + end + b"  Temp , s 25 h130" + end, 2) == b"STANDBY\r\nOK:TEMP,S 25 H130\r\n"


def test_a_line_may_come_letter_by_letter_and_after_junk(machine: FakeChamber) -> None:
    conversation = line_conversation(P300Controller(machine).execute)
    answers = [conversation.feed(bytes([byte])) for byte in b"\x00\xff\x00MODE?\r\n"]
    assert b"".join(answers) == b"STANDBY\r\n"


@pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")
def test_a_session_at_a_terminal_on_a_serial_port(machine: FakeChamber) -> None:
    import serial

    with SimulatedEspecP300(machine, over_tcp=False) as twin:
        assert twin.address.startswith("serial:///dev/")
        assert twin.address.endswith("?baud=9600")
        port = twin.address.removeprefix("serial://").partition("?")[0]
        with serial.Serial(port, 9600, timeout=5.0) as terminal:
            for request, answer in (
                (b"TEMP?\r\n", b"23.0,20.0,180.0,-75.0\r\n"),
                (b"TEMP, S-40.0\r\n", b"OK:TEMP,S-40.0\r\n"),
                (b"TEMP, S200.0\r\n", b"NA:DATA OUT OF RANGE\r\n"),
                (b"TEMP, S\x0720.0\r\n", b"NA:PARA ERR\r\n"),
                (b"HELLO\r\n", b"NA:CMD ERR\r\n"),
            ):
                terminal.write(request)
                assert terminal.read_until(b"\n") == answer
    assert machine.setpoint == -40.0


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("TENMP?", "NA:CMD ERR"),
        ("TEMPER,S20", "NA:CMD ERR"),
        ("?", "NA:CMD ERR"),
        ("", "NA:CMD ERR"),
        ("1,TEMP?", "NA:ADDR ERR"),
        ("TEMP?,DETAIL", "NA:PARA ERR"),
        ("TEMP", "NA:PARA ERR"),
        ("TEMP, SOFF", "NA:PARA ERR"),
        ("TEMP, S25.0 X1", "NA:PARA ERR"),
        ("TEMP, S180.1", "NA:DATA OUT OF RANGE"),
        ("TEMP, S-75.1", "NA:DATA OUT OF RANGE"),
        ("TEMP, H19.9", "NA:DATA OUT OF RANGE"),
        ("TEMP, L20.1", "NA:DATA OUT OF RANGE"),
        ("TEMP, H180.1", "NA:DATA OUT OF RANGE"),
        ("TEMP, S20.0 H20.0 L20.0", "NA:DATA OUT OF RANGE"),
        ("HUMI?", "NA:CONT NOT READY-1"),
        ("HUMI, S50", "NA:CONT NOT READY-1"),
        ("MODE,SLEEP", "NA:PARA ERR"),
        ("MODE,RUN1", "NA:DATA NOT READY"),
        ("PRGM,RUN,RAM:1,STEP1", "NA:DATA NOT READY"),
        ("PRGM,END,STANDBY", "NA:CONT NOT READY-2"),
        ("PRGM,END,SOON", "NA:PARA ERR"),
        ("PRGM,PAUSE", "NA:CONT NOT READY-2"),
        ("PRGM DATA WRITE,PGM1,EDIT START", "NA:PRGM WRITE ERR-1"),
        ("DATE,2026-11-23", "NA:PARA ERR"),
        ("SET,REF2", "NA:PARA ERR"),
        ("SRQ,CLEAR", "NA:PARA ERR"),
        ("POWER", "NA:PARA ERR"),
        ("RELAY,ON", "NA:PARA ERR"),
        ("RELAY,ON,13", "NA:PARA ERR"),
    ],
)
def test_what_is_wrong_is_refused_with_the_reason_and_changes_nothing(
    controller: P300Controller, machine: FakeChamber, line: str, answer: str
) -> None:
    before = controller.execute("TEMP?")
    assert controller.execute(line) == answer
    assert controller.execute("TEMP?") == before
    assert machine.switched == 0


def test_a_set_point_waits_in_standby_and_acts_in_constant(controller: P300Controller, machine: FakeChamber) -> None:
    assert controller.execute("TEMP, S-40.0") == "OK:TEMP,S-40.0"
    assert (machine.setpoint, machine.on, controller.execute("MODE?")) == (-40.0, False, "STANDBY")
    controller.execute("MODE,CONSTANT")
    assert (machine.on, controller.execute("MODE?")) == (True, "CONSTANT")
    controller.execute("MODE,STANDBY")
    assert machine.on is False


def test_alarms_are_set_with_the_set_point_in_one_line(controller: P300Controller, machine: FakeChamber) -> None:
    assert controller.execute("TEMP, S100.0 H130.0 L90.0") == "OK:TEMP,S100.0 H130.0 L90.0"
    answer = controller.execute("TEMP?")
    assert answer == "23.0,100.0,130.0,90.0"
    assert read_temperatures(answer).high_c == 130.0
    assert controller.execute("TEMP, S130.1") == "NA:DATA OUT OF RANGE"
    assert machine.setpoint == 100.0


@pytest.mark.parametrize("mode", ["RUN", "RUN PAUSE", "RMT RUN END HOLD"])
def test_while_a_program_runs_settings_are_refused_and_it_can_be_ended(
    controller: P300Controller, machine: FakeChamber, mode: str
) -> None:
    controller.run_program(mode)
    assert (controller.execute("MODE?"), controller.execute("MODE?,DETAIL")) == ("RUN", mode)
    assert controller.execute("MON?,DETAIL") == f"23.0,,{mode},0"
    for line in ("TEMP, S30.0", "MODE,CONSTANT", "RELAY,ON,1"):
        assert controller.execute(line) == "NA:CHB NOT READY"
    assert machine.setpoint == 20.0
    assert controller.execute("PRGM,END,STANDBY") == "OK:PRGM,END,STANDBY"
    assert (machine.on, controller.execute("MODE?")) == (False, "STANDBY")


def test_protection_refuses_settings_and_answers_queries(controller: P300Controller, machine: FakeChamber) -> None:
    controller.protected = True
    for line in ("TEMP, S30.0", "MODE,CONSTANT", "POWER,OFF", "RELAY,ON,1"):
        assert controller.execute(line) == "NA:PROTECT ON"
    assert controller.execute("MODE?") == "STANDBY"
    controller.protected = False
    assert controller.execute("TEMP, S30.0") == "OK:TEMP,S30.0"


def test_switched_off_it_answers_queries_until_it_is_switched_on(
    controller: P300Controller, machine: FakeChamber
) -> None:
    controller.execute("MODE,CONSTANT")
    assert controller.execute("POWER,off") == "OK:POWER,OFF"
    assert (machine.on, controller.execute("MODE?")) == (False, "OFF")
    for line in ("TEMP, S30.0", "MODE,CONSTANT", "MODE,STANDBY"):
        assert controller.execute(line) == "NA:CHB NOT READY"
    assert controller.execute("POWER,ON") == "OK:POWER,ON"
    assert (machine.on, controller.execute("MODE?")) == (True, "CONSTANT")


def test_air_beyond_an_alarm_is_latched_until_it_is_cleared_by_hand(
    controller: P300Controller, machine: FakeChamber
) -> None:
    controller.execute("TEMP, S20.0 H60.0 L-20.0")
    machine.air = 61.0
    assert controller.execute("ALARM?") == "0"  # in standby nothing is controlled, and nothing is amiss
    controller.execute("MODE,CONSTANT")
    for air_c, answer in ((60.0, "0"), (60.1, "1,1"), (20.0, "1,1"), (-20.1, "2,1,2")):
        machine.air = air_c
        assert controller.execute("ALARM?") == answer
    machine.air = 20.0
    assert (controller.execute("MON?"), controller.execute("SRQ?")) == ("20.0,,CONSTANT,2", "01000000")
    controller.clear_alarms()
    controller.raise_alarm(12)
    assert controller.execute("ALARM?") == "1,12"


def test_time_signals_are_switched(controller: P300Controller) -> None:
    assert controller.execute("RELAY?") == "0"
    controller.execute("RELAY,ON,1,2,12")
    controller.execute("RELAY,OFF,2")
    assert controller.execute("RELAY?") == "2,1,12"


def test_on_a_bus_it_answers_only_its_own_number(machine: FakeChamber) -> None:
    conversation = line_conversation(P300Controller(machine, rs485_address=3).execute)
    assert conversation.feed(b"4,TEMP, S30.0\r\nTEMP, S30.0\r\n" + b"x" * 5000 + b"\r\n") == b""
    assert machine.setpoint == 20.0
    assert conversation.feed(b"3,TEMP, S30.0\r\n") == b"OK:TEMP,S30.0\r\n"
    assert conversation.feed(b"3,TEMP?\r\n") == b"23.0,30.0,180.0,-75.0\r\n"


def test_a_line_without_end_is_refused_and_forgotten(machine: FakeChamber) -> None:
    conversation = line_conversation(P300Controller(machine).execute)
    assert conversation.feed(b"x" * 5000) == b"NA:CMD ERR\r\n"
    assert conversation.feed(b"MODE?\r\n") == b"STANDBY\r\n"


def test_every_answer_is_one_that_the_readers_read(controller: P300Controller, machine: FakeChamber) -> None:
    machine.air, machine.setpoint, machine.power = -0.04, -0.01, -30.0
    controller.raise_alarm(7)
    readers = {
        "TEMP?": read_temperatures,
        "MODE?": read_mode,
        "MODE?,DETAIL": read_mode,
        "ALARM?": read_alarms,
        "TYPE?": read_type,
        "%?": read_heater,
    }
    answers = {query: controller.execute(query) for query in readers}
    assert answers["TEMP?"] == "0.0,0.0,180.0,-75.0"
    assert answers["%?"] == "1,0.0"  # cooling does not show
    for query, read in readers.items():
        answer = answers[query]
        assert answer is not None
        assert read(answer) is not None


@settings(deadline=None)
@given(
    st.lists(
        st.binary(max_size=60)
        | st.sampled_from(
            [b"TEMP, S", b"MODE,", b"RELAY,ON,", b"PRGM,END,", b"3,", b"\r\n", b"25.0 H130", b"HOLD", b"1"]
        ),
        max_size=30,
    )
)
def test_no_bytes_break_the_controller(pieces: list[bytes]) -> None:
    conversation = line_conversation(P300Controller(FakeChamber()).execute)
    for piece in pieces:
        for answer in conversation.feed(piece).split(b"\r\n")[:-1]:
            assert answer
            assert answer.isascii()
    assert conversation.feed(b"\r\nROM?\r\n").endswith(b"SIMULATED 1.00\r\n")
