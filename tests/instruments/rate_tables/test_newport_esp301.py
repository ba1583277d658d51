"""The driver against the simulated controller, over a pseudo-terminal and over TCP."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator

import pytest

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.interfaces import Identity, RateTable, TableLimits, TableState
from benchctl_instruments.links.serial_port import byte_link
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.rate_tables.newport_esp301 import Esp301
from benchctl_instruments.simulated.newport_esp301 import SimulatedEsp301
from tests.instruments.table_machine import CountedClock, InstantTable

LIMITS = TableLimits(rate_dps=300.0, acceleration_dps2=500.0)


@pytest.fixture
def table() -> InstantTable:
    return InstantTable()


@pytest.fixture(params=["pty", "tcp"])
def server(request: pytest.FixtureRequest, table: InstantTable) -> Iterator[SimulatedEsp301]:
    if request.param == "pty" and sys.platform == "win32":
        pytest.skip("Windows has no pseudo-terminals")
    with SimulatedEsp301(table, over_tcp=request.param == "tcp") as running:
        table.angle_deg = 350.0  # since power-up
        yield running


@pytest.fixture
def log() -> WireLog:
    return WireLog(size=1000)


@pytest.fixture
def driver(server: SimulatedEsp301, log: WireLog) -> Iterator[Esp301]:
    with Esp301(server.address, clock=CountedClock(), wire_log=log) as driver:
        yield driver


@pytest.fixture
def enabled(driver: Esp301, table: InstantTable) -> Esp301:
    driver.set_limits(LIMITS)
    driver.enable()
    table.demands.clear()
    return driver


def sent(log: WireLog) -> list[str]:
    """The commands that went over the wire, without queries."""
    lines = [entry.data.decode().rstrip("\r") for entry in log.last(1000) if entry.direction == "sent"]
    return [line for line in lines if "?" not in line]


def test_it_is_a_rate_table_and_says_who_it_is(driver: Esp301) -> None:
    as_interface: RateTable = driver
    assert as_interface.identify() == Identity(model="ESP301", firmware="Version 3.0.1 simulated")


def test_it_starts_disabled_and_enabling_holds_it_still(driver: Esp301, table: InstantTable) -> None:
    assert driver.state() is TableState.DISABLED
    driver.enable()
    assert driver.state() is TableState.AT_REST
    assert table.demands == [("close",), ("rate", 0.0)]


def test_everything_it_commands_byte_for_byte(driver: Esp301, log: WireLog) -> None:
    driver.set_limits(LIMITS)
    driver.enable()
    driver.go_to_rate(20.0)
    driver.go_to_rate(30.0)
    driver.go_to_rate(-30.0)
    driver.go_to_angle(10.0)
    driver.stop()
    driver.disable()
    assert sent(log) == [
        "1AC500.000000",
        "1AG500.000000",
        "1MO",
        "1ST",
        "1VA20.000000",
        "1MV+",
        "1VA30.000000",
        "1ST",
        "1VA30.000000",
        "1MV-",
        "1ST",
        "1VA300.000000",
        "1PA370.000000",
        "1ST",
        "1ST",
        "1MF",
    ]


def test_errors_are_asked_for_after_every_command(driver: Esp301, log: WireLog) -> None:
    driver.enable()
    lines = [entry.data for entry in log.last(1000) if entry.direction == "sent"]
    for command in (b"1MO\r", b"1ST\r"):
        assert lines[lines.index(command) + 1] == b"TE?\r"


def test_a_rate_is_reached_and_read_back(enabled: Esp301, table: InstantTable) -> None:
    enabled.go_to_rate(-123.456)
    assert table.rate_dps == pytest.approx(-123.456)
    reading = enabled.read()
    assert (reading.angle_deg, reading.rate_dps) == (350.0, -123.456)
    assert math.isnan(reading.acceleration_dps2)
    assert enabled.state() is TableState.MOVING


def test_a_stage_that_counts_clockwise_is_driven_the_other_way(server: SimulatedEsp301, table: InstantTable) -> None:
    with Esp301(server.address, clock=CountedClock(), clockwise=True) as driver:
        driver.set_limits(LIMITS)
        driver.enable()
        driver.go_to_rate(10.0)
        assert table.rate_dps == -10.0
        assert driver.read().rate_dps == 10.0
        driver.go_to_angle(20.0)  # it stands at -350 deg, which is 10
        assert table.angle_deg == pytest.approx(340.0)


def test_the_same_direction_needs_no_stop_and_the_other_one_does(enabled: Esp301, table: InstantTable) -> None:
    enabled.go_to_rate(100.0)
    enabled.go_to_rate(50.0)
    assert table.demands == [("rate", 100.0), ("rate", 50.0)]
    table.demands.clear()
    enabled.go_to_rate(-50.0)
    enabled.go_to_rate(0.0)
    assert table.demands == [("rate", 0.0), ("rate", -50.0), ("rate", 0.0)]
    assert enabled.state() is TableState.AT_REST


def test_a_table_that_turns_already_when_the_driver_comes_is_stopped_first(
    server: SimulatedEsp301, enabled: Esp301, table: InstantTable
) -> None:
    enabled.go_to_rate(100.0)
    enabled.close()
    table.demands.clear()
    with Esp301(server.address, clock=CountedClock()) as second:
        assert second.state() is TableState.MOVING
        second.set_limits(LIMITS)
        second.go_to_rate(10.0)
    assert table.demands == [("rate", 0.0), ("rate", 10.0)]


def test_what_the_controller_does_not_take_is_named(driver: Esp301, table: InstantTable) -> None:
    with pytest.raises(
        InstrumentError, match=r"sent '1AC9000.000000', it reports 111 \(axis 1: maximum acceleration exceeded\)"
    ):
        driver.set_limits(TableLimits(rate_dps=300.0, acceleration_dps2=9000.0))
    driver.set_limits(TableLimits(rate_dps=2000.0, acceleration_dps2=500.0))
    driver.enable()
    with pytest.raises(
        InstrumentError, match=r"sent '1VA1500.000000', it reports 110 \(axis 1: maximum velocity exceeded\)"
    ):
        driver.go_to_rate(1500.0)
    assert table.rate_dps == 0.0
    assert driver.state() is TableState.AT_REST


def test_a_disabled_table_does_not_move_and_can_be_stopped(driver: Esp301, table: InstantTable) -> None:
    driver.set_limits(LIMITS)
    driver.stop()
    with pytest.raises(InstrumentError, match=r"sent '1MV\+', it reports 113 \(axis 1: motor not enabled\)"):
        driver.go_to_rate(1.0)
    with pytest.raises(InstrumentError, match=r"its motor is off; enable the table first"):
        driver.go_to_rate(0.0)
    assert table.demands == []
    assert driver.state() is TableState.DISABLED


def test_an_emergency_stop_is_explained_and_cleared_by_enabling(enabled: Esp301, server: SimulatedEsp301) -> None:
    enabled.go_to_rate(20.0)
    server.open_interlock()
    assert enabled.state() is TableState.FAULT
    moves: list[Callable[[], None]] = [
        enabled.stop,
        lambda: enabled.go_to_rate(1.0),
        lambda: enabled.go_to_angle(1.0),
    ]
    for move in moves:
        with pytest.raises(InstrumentError, match=r"in fault: 4 \(emergency stop\); remove the cause") as caught:
            move()
        assert "\n" not in str(caught.value)
    with pytest.raises(InstrumentError, match=r"sent '1MO', it reports 129 \(axis 1: interlock"):
        enabled.enable()
    assert enabled.state() is TableState.FAULT
    assert enabled.read().rate_dps == 0.0

    server.close_interlock()
    assert enabled.state() is TableState.FAULT
    enabled.enable()
    assert enabled.state() is TableState.AT_REST


def test_a_rate_that_runs_away_is_seen(enabled: Esp301, table: InstantTable) -> None:
    enabled.go_to_rate(100.0)
    table.rate_dps = 1200.0
    assert enabled.state() is TableState.FAULT
    with pytest.raises(InstrumentError, match=r"103 \(axis 1: following error\)"):
        enabled.stop()


def test_a_software_limit_that_a_turning_table_meets_is_a_fault(
    server: SimulatedEsp301, enabled: Esp301, table: InstantTable
) -> None:
    enabled.go_to_rate(10.0)
    enabled.close()
    operator = byte_link(server.address)
    operator.open(2.0)
    operator.send(b"1SR360\r1SR?\r")
    assert operator.receive(64, 2.0).startswith(b"3")
    operator.close()
    enabled.open()
    assert enabled.state() is TableState.MOVING
    table.angle_deg = 361.0
    assert enabled.state() is TableState.FAULT
    assert table.rate_dps == 0.0
    with pytest.raises(InstrumentError, match=r"106 \(axis 1: positive software limit\)"):
        enabled.go_to_rate(10.0)
    enabled.enable()
    enabled.go_to_rate(-10.0)
    assert enabled.state() is TableState.MOVING


def test_a_line_at_its_real_speed_carries_the_dialogue(table: InstantTable) -> None:
    with (
        SimulatedEsp301(table, pace_baud=19200, over_tcp=sys.platform == "win32") as server,
        Esp301(server.address, clock=CountedClock()) as driver,
    ):
        driver.set_limits(LIMITS)
        driver.enable()
        driver.go_to_rate(-10.0)
        assert driver.state() is TableState.MOVING
        driver.stop()
        assert driver.state() is TableState.AT_REST
    assert table.demands == [("close",), ("rate", 0.0), ("rate", -10.0), ("rate", 0.0), ("rate", 0.0)]


def test_an_axis_that_counts_in_other_units_is_refused(server: SimulatedEsp301) -> None:
    operator = byte_link(server.address)
    operator.open(2.0)
    operator.send(b"1SN9;1SN?\r")
    assert operator.receive(64, 2.0).startswith(b"9")
    operator.close()
    driver = Esp301(server.address, clock=CountedClock())
    with pytest.raises(InstrumentError, match=r"counts in units 9, expected 7, degrees; set its units"):
        driver.open()


def test_an_axis_that_is_not_homed_turns_and_counts_from_where_it_was_switched_on(
    server: SimulatedEsp301, enabled: Esp301, table: InstantTable
) -> None:
    server.restart()
    enabled.set_limits(LIMITS)
    enabled.enable()
    enabled.go_to_rate(10.0)
    assert (table.rate_dps, enabled.read().angle_deg) == (10.0, 0.0)
    enabled.go_to_angle(20.0)
    assert table.angle_deg == pytest.approx(370.0)
