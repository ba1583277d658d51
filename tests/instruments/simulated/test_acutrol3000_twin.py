"""The simulated controller, spoken to with literal bytes."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

from benchctl_instruments.links.address import parse_address
from benchctl_instruments.simulated.acutrol3000 import AcutrolController, SimulatedAcutrol3000
from tests.instruments.table_machine import InstantTable


@pytest.fixture
def table() -> InstantTable:
    return InstantTable(angle_deg=350.0)


@pytest.fixture
def controller(table: InstantTable) -> AcutrolController:
    return AcutrolController(table)


@pytest.fixture
def wire(table: InstantTable) -> Iterator[socket.socket]:
    with SimulatedAcutrol3000(table) as server:
        address = parse_address(server.address)
        with socket.create_connection((address.host, address.port), timeout=2.0) as connection:
            yield connection


def said(wire: socket.socket, request: bytes, lines: int = 1) -> list[bytes]:
    wire.sendall(request)
    reply = b""
    while reply.count(b"\r\n") < lines:
        reply += wire.recv(4096)
    return [line[8:] for line in reply.splitlines()]


def told(controller: AcutrolController, *lines: str) -> None:
    for line in lines:
        assert controller.execute(line) == "OK", line


def test_every_line_gets_one_reply_under_a_header_of_eight_characters(wire: socket.socket) -> None:
    wire.sendall(b":utility:lockout on\r\n:interlock:reset 1\r\n")
    reply = b""
    while reply.count(b"\r\n") < 2:
        reply += wire.recv(4096)
    assert reply == b"00000001OK\r\n00000002OK\r\n"


def test_a_combined_read_over_the_wire_in_two_packets(wire: socket.socket) -> None:
    wire.sendall(b":read:pos? 1;ra")
    assert said(wire, b"te? 1;acc? 1\r\n") == [b"350.000000;0.000000;0.000000"]


def test_line_feed_alone_ends_a_command_too(wire: socket.socket) -> None:
    assert said(wire, b":mode? 1\n") == [b"Off"]


def test_a_line_without_end_is_refused_and_the_dialogue_goes_on(wire: socket.socket) -> None:
    (refusal,) = said(wire, b"x" * 5000)
    assert refusal.startswith(b"ERROR")
    assert said(wire, b":mode? 1\r\n") == [b"Off"]


def test_the_startup_of_a_published_driver_is_acknowledged(wire: socket.socket) -> None:
    lines = b":utility:lockout on\r\n:interlock:open 1\r\n:interlock:reset 1\r\n:interlock:close 1\r\n"
    assert said(wire, lines, 4) == [b"OK"] * 4
    assert said(wire, b":mode:rate 1\r\n:demand:rate 1, 06.300\r\n:read:rate 1\r\n", 3) == [b"OK", b"OK", b"6.300000"]


@pytest.mark.parametrize(
    "line",
    [
        ":jump 1",
        ":mode? 2",
        ":mode?",
        ":dem:rate 1,fast",
        ":dem:rate 1",
        ":dem:rate 1,nan",
        ":dem:acc 2,5",
        ":dem:delta 1,181",
        ":dem:delta? 1",
        ":lim:rate pos,1,1001",
        ":lim:rate pos,1,0",
        ":lim:rate",
        ":lim:acc jump,1,5",
        ":con:osc 1,Enable,2,0.1,Pos,Log",
        ":lposition",
        "*stb",
    ],
)
def test_what_it_cannot_do_is_refused_with_a_reason(controller: AcutrolController, line: str) -> None:
    answer = controller.execute(line)
    assert answer.startswith("ERROR ")
    assert len(answer) > len("ERROR ")


def test_no_mode_is_entered_while_the_interlock_is_open(controller: AcutrolController, table: InstantTable) -> None:
    assert controller.execute(":mode:rate 1") == "ERROR mode Rate: the interlock is open"
    assert controller.execute(":interlock? 1;:mode? 1") == "Open;Off"
    assert table.demands == []


def test_a_mode_starts_with_the_demand_that_was_loaded_last(controller: AcutrolController, table: InstantTable) -> None:
    told(controller, ":int:close 1", ":dem:rate 1,20")
    assert table.rate_dps == 0.0
    told(controller, ":mode 1,rate")
    assert table.rate_dps == 20.0
    told(controller, ":mode:off 1")
    assert table.rate_dps == 0.0
    told(controller, ":mode:arate 1")
    assert table.rate_dps == 20.0
    assert controller.execute(":mode? 1;:dem:rate? 1") == "AbsRate;20.000000"


def test_a_position_is_reached_the_short_way_round(controller: AcutrolController, table: InstantTable) -> None:
    told(controller, ":int:close 1", ":dem:pos 1,350", ":mode:pos 1", ":dem:pos 1,10")
    assert table.angle_deg == pytest.approx(370.0)
    told(controller, ":dem:delta 1,-30")
    assert table.angle_deg == pytest.approx(340.0)
    assert controller.execute(":d:p? 1") == "340.000000"


@pytest.mark.parametrize(
    ("kind", "amplitude", "slew"),
    [("Pos", 10.0, 2.0), ("Rate", 31.41592654, 6.283185307), ("Accel", 98.69604401, 19.7392088)],
)
def test_an_oscillation_is_given_as_angle_rate_or_acceleration(
    controller: AcutrolController, table: InstantTable, kind: str, amplitude: float, slew: float
) -> None:
    told(controller, ":int:close 1", f":con:osc 1,Enable,{slew},0.1,{kind},Lin", f":dem:osc 1,{amplitude},0.5,90")
    told(controller, ":mode:synt 1")

    name, *numbers = table.demands[-1]
    assert name == "sine"
    assert numbers == pytest.approx([10.0, 0.5, 90.0, 2.0])
    assert controller.execute(":con:osc? 1") == f"Enable,{slew:.6f},0.100000,{kind},Lin"


def test_an_oscillation_of_nothing_holds_still(controller: AcutrolController, table: InstantTable) -> None:
    told(controller, ":int:close 1", ":mode:synt 1", ":dem:osc 1,0,0,0")
    assert table.demands[-1] == ("rate", 0.0)


def test_each_mode_has_its_own_limits_and_the_axis_those_of_its_mode(
    controller: AcutrolController, table: InstantTable
) -> None:
    told(controller, ":lim:rate pos,1,50", ":lim:acc pos,1,60", ":lim:rate synt,1,90", ":int:close 1")
    assert table.limits() == (1000.0, 8300.0)
    told(controller, ":mode:pos 1")
    assert table.limits() == (50.0, 60.0)
    told(controller, ":lim:acc pos,1,70")
    assert table.limits() == (50.0, 70.0)
    told(controller, ":mode:rate 1")
    assert table.limits() == (1000.0, 8300.0)
    assert controller.execute(":limit:rate? pos,1;rate? rate,1;acc? synt,1") == "50.000000;1000.000000;8300.000000"
    assert controller.execute(":dem:osc 1,155,1,0").startswith("ERROR oscillation's rate")


def test_the_factory_limits_stay(controller: AcutrolController) -> None:
    told(controller, ":lim:rate rate,1,50")
    assert controller.execute(":limit:absolute? 1").split(",")[:2] == ["1000.000000", "8300.000000"]


def test_a_velocity_trip_aborts_and_stays_latched_until_reset(
    controller: AcutrolController, table: InstantTable
) -> None:
    told(controller, ":int:close 1", ":dem:rate 1,100", ":mode:rate 1", ":l:v 1,90")
    assert controller.execute(":mode? 1;:interlock? 1;*stb?") == "Abort;Fault;65"
    assert table.demands[-1] == ("open",)
    assert controller.execute(":int:close 1").startswith("ERROR interlock close: it is in fault")
    told(controller, ":interlock:reset")
    assert controller.execute(":mode? 1;:interlock? 1;*stb?") == "Off;Open;0"


def test_an_interlock_held_open_by_hand_cannot_be_reset(controller: AcutrolController) -> None:
    told(controller, ":int:close 1", ":mode:rate 1")
    controller.open_interlock()
    told(controller, ":interlock:reset 1")
    assert controller.execute(":interlock? 1") == "Fault"
    controller.close_interlock()
    assert controller.execute(":interlock? 1") == "Fault"
    told(controller, ":interlock:reset 1")
    assert controller.execute(":interlock? 1") == "Open"
