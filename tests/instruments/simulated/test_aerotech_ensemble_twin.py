"""The simulated Ensemble, spoken to with literal bytes."""

from __future__ import annotations

import socket

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.links.address import parse_address
from benchctl_instruments.protocols.ensemble import encode_reply
from benchctl_instruments.simulated.aerotech_ensemble import EnsembleController, SimulatedEnsemble
from tests.instruments.table_machine import InstantTable

ENABLED, IN_POSITION, MOVE_ACTIVE = 0x1, 0x4, 0x8


class StillOnItsWay(InstantTable):
    """It accepts an angle and never gets there."""

    def demand_angle(self, angle_deg: float) -> None:
        self.demands.append(("angle", angle_deg))


@pytest.fixture
def table() -> InstantTable:
    return InstantTable()


@pytest.fixture
def controller(table: InstantTable) -> EnsembleController:
    controller = EnsembleController(table)
    table.angle_deg = -350.0  # since power-up; 350 as the controller counts, clockwise
    return controller


def said(controller: EnsembleController, line: str) -> str:
    return encode_reply(controller.execute(line)).decode().rstrip("\n")


def told(controller: EnsembleController, *lines: str) -> None:
    for line in lines:
        assert said(controller, line) == "%", line


def status(controller: EnsembleController) -> int:
    return int(said(controller, "AXISSTATUS(@0)")[1:]) & 0xFFFFFFFF


def talk(address: str, request: bytes, lines: int) -> bytes:
    where = parse_address(address)
    with socket.create_connection((where.host, where.port), timeout=2.0) as wire:
        reply = b""
        for byte in request:  # one packet a byte
            wire.sendall(bytes([byte]))
        while reply.count(b"\n") < lines:
            reply += wire.recv(4096)
    return reply


def test_a_servo_that_hunts_about_its_place_takes_the_next_move(
    controller: EnsembleController, table: InstantTable
) -> None:
    told(controller, "ENABLE X", "MOVEABS X 10 XF 50")
    table.rate_dps = 0.02
    assert status(controller) & (IN_POSITION | MOVE_ACTIVE) == IN_POSITION
    told(controller, "MOVEABS X 20 XF 50")
    assert table.angle_deg == -20.0


def test_the_polling_of_a_published_driver_byte_for_byte(table: InstantTable) -> None:
    with SimulatedEnsemble(table) as server:
        table.angle_deg = -350.0  # since power-up
        request = b"AXISSTATUS(@0)\nPLANESTATUS(0)\nPFBKPROG(@0)\nPCMDPROG(@0)\nAXISFAULT(@0)\nVFBK(@0)\n"
        reply = b"%-2147483644\n%0\n%350.000000\n%350.000000\n%0\n%0.000000\n"
        assert talk(server.address, request, 6) == reply


def test_the_enabling_and_the_jog_of_a_published_driver_byte_for_byte(table: InstantTable) -> None:
    with SimulatedEnsemble(table) as server:
        request = (
            b"NONE\nRAMP MODE @0 RATE\nENABLE @0\nWAIT MODE NOWAIT\nSETPARM @0, 73, 500.0\n"
            b"RAMP RATE @0 500.0\nFREERUN @0 25.0\nVFBK(@0)\nABORT @0\nDISABLE @0\n"
        )
        assert talk(server.address, request, 10) == b"!\n%\n%\n%\n%\n%\n%\n%25.000000\n%\n%\n"
    assert ("rate", -25.0) in table.demands


def test_data_may_come_behind_a_bare_line(table: InstantTable) -> None:
    with SimulatedEnsemble(table, bare_lines=True) as server:
        assert talk(server.address, b"AXISFAULT(@0)\nENABLE @0\n", 3) == b"%\n%0\n%\n"


def test_a_line_without_end_is_not_understood_and_the_dialogue_goes_on(table: InstantTable) -> None:
    with SimulatedEnsemble(table) as server:
        where = parse_address(server.address)
        with socket.create_connection((where.host, where.port), timeout=2.0) as wire:
            wire.sendall(b"x" * 5000)
            assert wire.recv(16) == b"!\n"
            wire.sendall(b"AXISFAULT X\n")
            assert wire.recv(16) == b"%0\n"


@pytest.mark.parametrize(
    "line",
    [
        "JUMP @0",
        "ENABLE",
        "ENABLE @3",
        "ENABLE D",
        "ENABLE @",
        "ENABLE XY",
        "ENABLE @0 @0",
        "AXISSTATUS(@9)",
        "PLANESTATUS(1)",
        "FREERUN @0",
        "FREERUN @0 fast",
        "FREERUN @0 nan",
        "RAMP RATE @0 0",
        "RAMP RATE @0 99999",
        "RAMP RATE",
        "RAMP MODE @0 TIME",
        "WAIT MODE LONG",
        "LINEAR @0 10 5",
        "LINEAR @0 10 F0",
        "LINEAR @0",
        "LINEAR F10",
        "LINEAR @0 10 @1F 5",
        "MOVEABS X 10 XF 5 X 20",
        "MOVEABS X ten",
        "HOME",
        "IGLOBAL(33) 1",
        'PROGRAM RUN 5, "Other.bcx"',
        "SCURVE 101",
        "GETPARM(@0, 900)",
        "GETPARM(@0)",
        "SETPARM @0, 73, slow",
        "INC @0",
        "12",
    ],
)
def test_what_does_not_exist_is_not_understood_and_changes_nothing(
    controller: EnsembleController, table: InstantTable, line: str
) -> None:
    told(controller, "ENABLE @0")
    table.demands.clear()
    assert said(controller, line) == "!"
    assert table.demands == []
    assert status(controller) & 0xF == ENABLED | IN_POSITION


def test_nothing_moves_while_the_axis_is_disabled(controller: EnsembleController, table: InstantTable) -> None:
    assert said(controller, "FREERUN @0 10") == "#"
    assert said(controller, "LINEAR @0 10 F10") == "#"
    told(controller, "ABORT @0", "DISABLE @0")
    assert [demand for demand in table.demands if demand[0] in ("rate", "angle")] == []


def test_a_positive_rate_turns_clockwise(controller: EnsembleController, table: InstantTable) -> None:
    told(controller, "ENABLE X", "FREERUN X 20")
    assert table.rate_dps == -20.0
    assert status(controller) & 0x20F == ENABLED | MOVE_ACTIVE
    told(controller, "FREERUN X -20")
    assert table.rate_dps == 20.0
    assert status(controller) & 0x200


def test_each_kind_of_motion_has_its_own_ramp(controller: EnsembleController, table: InstantTable) -> None:
    told(controller, "ENABLE @0", "WAIT MODE NOWAIT", "RAMP RATE @0 100", "RAMP RATE 200", "SETPARM @0, 73, 300")
    told(controller, "FREERUN @0 10")
    assert table.limits() == (1000.0, 100.0)
    told(controller, "ABORT @0")
    assert table.limits() == (1000.0, 300.0)
    told(controller, "ABS", "LINEAR @0 10 F50")
    assert table.limits() == (50.0, 200.0)
    assert said(controller, "GETPARM(@0, 73)") == "%300.000000"


def test_a_move_is_absolute_or_by_an_increment(controller: EnsembleController, table: InstantTable) -> None:
    told(controller, "ENABLE @0", "WAIT MODE NOWAIT", "LINEAR @0 340 F10")
    assert table.angle_deg == pytest.approx(-340.0)
    told(controller, "INC", "LINEAR @0 25 F10")
    assert table.angle_deg == pytest.approx(-365.0)
    told(controller, "ABS", "LINEAR @0 0 F10")
    assert table.angle_deg == pytest.approx(0.0)


@pytest.mark.parametrize("line", ["LINEAR @0 340 F10", "MOVEABS X 340 F 10", "HOME X"])
def test_a_motion_goes_on_when_its_wait_is_over(line: str) -> None:
    table = StillOnItsWay(angle_deg=-340.0)
    controller = EnsembleController(table)
    table.angle_deg = -350.0
    told(controller, "ENABLE @0", "SETPARM @0, 202, 20")  # 20 ms
    assert said(controller, line) == "$"
    assert table.demands[-1] == ("angle", -360.0 if line == "HOME X" else -680.0)
    assert not status(controller) & IN_POSITION


def test_one_kind_of_motion_does_not_begin_in_the_other() -> None:
    controller = EnsembleController(StillOnItsWay())
    told(controller, "ENABLE @0", "WAIT MODE NOWAIT", "FREERUN @0 10")
    assert said(controller, "LINEAR @0 10 F10") == "#"
    told(controller, "ABORT @0", "LINEAR @0 10 F10")
    assert said(controller, "PLANESTATUS(0)") == "%1"
    assert said(controller, "FREERUN @0 10") == "#"
    assert said(controller, "LINEAR @0 20 F10") == "#"
    told(controller, "ABORT @0")
    assert said(controller, "PLANESTATUS(0)") == "%0"
    told(controller, "FREERUN @0 10")


@pytest.mark.parametrize(("rate_dps", "angle_deg", "fault"), [(10, -91.0, 4), (-10, 91.0, 5)])
def test_a_software_limit_disables_the_axis_that_turns_into_it(
    controller: EnsembleController, table: InstantTable, rate_dps: int, angle_deg: float, fault: int
) -> None:
    table.angle_deg = 0.0
    told(controller, "SETPARM @0, 37, -90", "SETPARM @0, 38, 90", "ENABLE @0", f"FREERUN @0 {rate_dps}")
    assert said(controller, "AXISFAULT(@0)") == "%0"
    table.angle_deg = angle_deg
    assert said(controller, "AXISFAULT(@0)") == f"%{1 << fault}"
    assert table.demands[-1] == ("open",)
    told(controller, "FAULTACK @0", "ENABLE @0", f"FREERUN @0 {-rate_dps}")
    assert said(controller, "AXISFAULT(@0)") == "%0"


def test_a_rate_beyond_the_drive_s_is_acknowledged_and_is_a_fault(
    controller: EnsembleController, table: InstantTable
) -> None:
    told(controller, "ENABLE @0", "FREERUN @0 1001")
    assert said(controller, "AXISFAULT(@0)") == "%1024"
    assert not status(controller) & ENABLED
    assert not any(demand[0] == "rate" for demand in table.demands)


def test_a_rate_that_runs_away_is_a_fault(controller: EnsembleController, table: InstantTable) -> None:
    told(controller, "ENABLE @0", "FREERUN @0 100")
    table.rate_dps = 1200.0
    assert said(controller, "AXISFAULT(@0)") == "%4096"
    assert table.demands[-1] == ("open",)


def test_a_fault_is_latched_until_it_is_acknowledged(controller: EnsembleController) -> None:
    told(controller, "ENABLE @0", "FREERUN @0 1001")
    assert said(controller, "ENABLE @0") == "#"
    told(controller, "FAULTACK @0", "ENABLE @0")
    assert status(controller) & ENABLED


def test_an_emergency_stop_that_is_pressed_cannot_be_acknowledged_away(controller: EnsembleController) -> None:
    told(controller, "ENABLE @0", "FREERUN @0 10")
    controller.open_interlock()
    assert status(controller) & 0x80000009 == 0
    told(controller, "FAULTACK @0")
    assert said(controller, "AXISFAULT(@0)") == "%2048"
    controller.close_interlock()
    assert said(controller, "AXISFAULT(@0)") == "%2048"
    told(controller, "FAULTACK @0", "ENABLE @0")
    assert status(controller) & 0x80000009 == 0x80000001


def test_a_following_error_is_a_latched_position_error(controller: EnsembleController, table: InstantTable) -> None:
    told(controller, "ENABLE @0", "FREERUN @0 10")
    controller.trip()
    assert said(controller, "AXISFAULT(@0)") == "%1"
    assert table.demands[-1] == ("open",)
    told(controller, "FAULTACK @0", "ENABLE @0")
    assert said(controller, "AXISFAULT(@0)") == "%0"


def test_after_a_restart_it_is_as_delivered_and_only_a_pressed_stop_is_still_a_fault(
    controller: EnsembleController,
) -> None:
    told(controller, "ENABLE @0", "WAIT MODE NOWAIT", "SETPARM @0, 73, 300", "FREERUN @0 10")
    controller.trip()
    controller.restart()
    assert status(controller) & 0xF == IN_POSITION
    assert said(controller, "AXISFAULT(@0)") == "%0"
    assert said(controller, "GETPARM(@0, 73)") == "%8300.000000"
    controller.open_interlock()
    controller.restart()
    assert said(controller, "AXISFAULT(@0)") == "%2048"


@settings(deadline=None, max_examples=50)
@given(st.text(max_size=30) | st.text("FRENULIAT @0X1(),.-F", max_size=30))
def test_no_line_breaks_the_controller(line: str) -> None:
    controller = EnsembleController(InstantTable())
    assert encode_reply(controller.execute(line))[:1] in (b"%", b"!", b"#", b"$")
