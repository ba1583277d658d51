"""The simulated ESP301, spoken to with literal bytes."""

from __future__ import annotations

import socket
import sys
import time
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.links.address import parse_address
from benchctl_instruments.links.serial_port import byte_link
from benchctl_instruments.simulated.newport_esp301 import Esp301Controller, SimulatedEsp301
from tests.instruments.table_machine import InstantTable


class Coasting(InstantTable):
    """It turns on when it is stopped."""

    def demand_rate(self, rate_dps: float) -> None:
        self.rate_dps = rate_dps or self.rate_dps


@pytest.fixture
def table() -> InstantTable:
    return InstantTable()


@pytest.fixture
def controller(table: InstantTable) -> Esp301Controller:
    controller = Esp301Controller(table)
    table.angle_deg = 350.0  # since power-up
    return controller


@pytest.fixture
def on(controller: Esp301Controller, table: InstantTable) -> Esp301Controller:
    told(controller, "1MO")
    table.demands.clear()
    return controller


def told(controller: Esp301Controller, *lines: str) -> None:
    for line in lines:
        assert controller.execute(line) == [], line
        assert controller.execute("TE?") == ["0"], line


def error_of(controller: Esp301Controller, line: str) -> str:
    assert controller.execute(line) == []
    (code,) = controller.execute("TE?")
    assert controller.execute("TE?") == ["0"]
    return code


@pytest.fixture(params=["pty", "tcp"])
def server(request: pytest.FixtureRequest, table: InstantTable) -> Iterator[SimulatedEsp301]:
    if request.param == "pty" and sys.platform == "win32":
        pytest.skip("Windows has no pseudo-terminals")
    with SimulatedEsp301(table, over_tcp=request.param == "tcp") as running:
        table.angle_deg = 350.0  # since power-up
        yield running


def test_a_session_byte_for_byte_over_either_line(server: SimulatedEsp301, table: InstantTable) -> None:
    link = byte_link(server.address)
    link.open(2.0)
    said = b""
    link.send(b"VE?\r1SN?\r01TP\r1MO;1MV+;1MD?;TE?\r1VA25.5\r1VA?;1TV?\r")
    expected = b"ESP301 Version 3.0.1 simulated\r\n7\r\n350.000000\r\n0\r\n0\r\n25.500000\r\n25.500000\r\n"
    while len(said) < len(expected):
        said += link.receive(4096, 2.0)
    assert said == expected
    link.send(b"1ST\r1MF\r2TP?\rTB?\r")
    said = link.receive(4096, 2.0)
    while b"\r\n" not in said:
        said += link.receive(4096, 2.0)
    link.close()
    assert said.startswith(b"208, ")
    assert said.endswith(b", AXIS 2: MOTOR OR STAGE NOT CONNECTED\r\n")
    assert table.demands[-1] == ("open",)


def test_nothing_but_a_query_is_answered(controller: Esp301Controller) -> None:
    assert controller.execute("1MO;1VA10;1AC20;1AG20;1MV+;1ST;1MF;1DH0") == []
    assert controller.execute("1MO?;1MD?;1MV?;VE?") == ["0", "1", "1", "ESP301 Version 3.0.1 simulated"]


def test_bytes_at_its_line_s_speed_take_their_time(table: InstantTable) -> None:
    with SimulatedEsp301(table, pace_baud=1200, over_tcp=True) as server:
        where = parse_address(server.address)
        with socket.create_connection((where.host, where.port), timeout=5.0) as wire:
            started_s = time.monotonic()
            wire.sendall(b"VE?\r")
            said = b""
            while not said.endswith(b"\n"):
                said += wire.recv(64)
    assert time.monotonic() - started_s > 32 * 10 / 1200


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("1XX", "6"),
        ("1", "6"),
        ("1XX?", "6"),
        ("MO", "37"),
        ("4MO", "9"),
        ("0MO", "9"),
        ("2MO", "208"),
        ("3TP?", "308"),
        ("1VA", "38"),
        ("1VAfast", "7"),
        ("1VAnan", "7"),
        ("1VA0", "7"),
        ("1VA-5", "7"),
        ("1VA1001", "110"),
        ("1AC8301", "111"),
        ("1AG8301", "111"),
        ("1MV", "38"),
        ("1MV*", "7"),
        ("1PA", "38"),
        ("1PAthere", "7"),
    ],
)
def test_what_is_wrong_with_a_command_is_in_the_queue_once(
    on: Esp301Controller, table: InstantTable, line: str, code: str
) -> None:
    assert error_of(on, line) == code
    assert table.demands == []


@pytest.mark.parametrize("line", ["1MV+", "1MV-", "1PA10", "1PR10"])
def test_nothing_moves_while_the_motor_is_off(controller: Esp301Controller, table: InstantTable, line: str) -> None:
    assert error_of(controller, line) == "113"
    assert table.demands == []


def test_the_queue_answers_its_oldest_error_first_and_holds_ten(controller: Esp301Controller) -> None:
    controller.execute("MO;" + "1XX;" * 10 + "9MO")
    codes = [controller.execute("TE?")[0] for _ in range(11)]
    assert codes == ["6"] * 9 + ["9", "0"]
    controller.execute("1MV+")
    (answer,) = controller.execute("TB?")
    code, _, text = answer.split(", ")
    assert (code, text) == ("113", "AXIS 1: MOTOR NOT ENABLED")
    assert controller.execute("TB?")[0].startswith("0, ")


def test_it_turns_at_its_velocity_and_a_new_one_acts_at_once(on: Esp301Controller, table: InstantTable) -> None:
    told(on, "1VA20", "1AC50", "1AG60", "1MV+")
    assert (table.rate_dps, table.limits()) == (20.0, (1000.0, 50.0))
    told(on, "1VA30")
    assert table.rate_dps == 30.0
    assert on.execute("1MD?;1TV?") == ["0", "30.000000"]
    told(on, "1ST")
    assert (table.rate_dps, table.limits()) == (0.0, (1000.0, 60.0))
    told(on, "1MV-")
    assert table.rate_dps == -30.0


@pytest.mark.parametrize("line", ["1MV-", "1MV+", "1PA10", "1PR10"])
def test_no_motion_begins_in_another(on: Esp301Controller, table: InstantTable, line: str) -> None:
    told(on, "1MV+")
    table.demands.clear()
    assert error_of(on, line) == "27"
    assert table.demands == []


def test_an_angle_is_counted_from_where_it_was_defined(on: Esp301Controller, table: InstantTable) -> None:
    told(on, "1PA360")
    assert table.angle_deg == 360.0
    told(on, "1PR-20", "1DH100", "1PA110")
    assert table.angle_deg == pytest.approx(350.0)
    assert on.execute("1TP?") == ["110.000000"]
    told(on, "1DH")
    assert on.execute("1TP?") == ["0.000000"]


def test_a_servo_that_hunts_about_its_place_is_done_and_takes_the_next_move(
    on: Esp301Controller, table: InstantTable
) -> None:
    told(on, "1PA10")
    assert on.execute("1MD?") == ["1"]
    table.rate_dps = 0.02
    assert on.execute("1MD?") == ["1"]
    told(on, "1PA20")
    assert table.angle_deg == 20.0


def test_an_axis_that_was_stopped_moves_until_it_is_at_rest() -> None:
    table = Coasting()
    controller = Esp301Controller(table)
    told(controller, "1MO", "1MV+", "1ST")
    assert controller.execute("1MD?") == ["0"]
    table.rate_dps = 0.0
    assert controller.execute("1MD?") == ["1"]


@pytest.mark.parametrize(("line", "code"), [("1PA391", "106"), ("1PR50", "106"), ("1PA309", "107"), ("1PR-50", "107")])
def test_a_move_beyond_a_software_limit_is_refused(
    on: Esp301Controller, table: InstantTable, line: str, code: str
) -> None:
    told(on, "1SL310", "1SR390")
    assert error_of(on, line) == code
    assert table.demands == []


@pytest.mark.parametrize(("turn", "angle_deg", "code"), [("+", 400.0, "106"), ("-", 300.0, "107")])
def test_a_software_limit_stops_the_axis_that_turns_into_it(
    on: Esp301Controller, table: InstantTable, turn: str, angle_deg: float, code: str
) -> None:
    told(on, "1SL310", "1SR390", f"1MV{turn}")
    table.angle_deg = angle_deg
    assert on.execute("1MD?;TE?;1MO?") == ["1", code, "1"]
    assert table.rate_dps == 0.0
    told(on, f"1MV{'-' if turn == '+' else '+'}")
    assert on.execute("1MD?;TE?") == ["0", "0"]


def test_a_rate_that_runs_away_switches_the_motor_off(on: Esp301Controller, table: InstantTable) -> None:
    told(on, "1MV+")
    table.rate_dps = 1200.0
    assert on.execute("1MO?;TE?") == ["0", "103"]
    assert table.demands[-1] == ("open",)


def test_the_motor_stays_off_while_the_emergency_stop_is_pressed(on: Esp301Controller, table: InstantTable) -> None:
    told(on, "1MV+")
    on.open_interlock()
    assert on.execute("TE?;1MO?;1MD?") == ["4", "0", "1"]
    assert error_of(on, "1MO") == "129"
    on.close_interlock()
    assert on.execute("1MO?") == ["0"]
    told(on, "1MO")
    assert on.execute("1MO?;1MD?") == ["1", "1"]
    assert table.rate_dps == 0.0


def test_a_following_error_switches_the_motor_off(on: Esp301Controller, table: InstantTable) -> None:
    told(on, "1MV+")
    on.trip()
    assert on.execute("TE?;1MO?;1MD?") == ["103", "0", "1"]
    assert table.demands[-1] == ("open",)


def test_after_a_restart_it_is_as_delivered_with_an_empty_queue(on: Esp301Controller) -> None:
    told(on, "1VA20", "1AG30", "1SR360", "1DH", "1MV+")
    on.execute("1XX")
    on.restart()
    assert on.execute("TE?;1MO?;1MD?;1VA?;1AG?;1TP?") == ["0", "0", "1", "1000.000000", "8300.000000", "0.000000"]


@settings(deadline=None, max_examples=50)
@given(st.text(max_size=30) | st.text("0123;?TEMOVASPR+-. ", max_size=30))
def test_no_line_breaks_the_controller(line: str) -> None:
    controller = Esp301Controller(InstantTable())
    assert len(controller.execute(line)) <= line.count(";") + 1
    assert controller.execute("VE?") == ["ESP301 Version 3.0.1 simulated"]
