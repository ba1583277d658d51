"""The driver against the simulated controller, over a real socket."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import pytest

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.interfaces import Identity, RateTable, TableLimits, TableState
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.rate_tables.aerotech_ensemble import Ensemble
from benchctl_instruments.simulated.aerotech_ensemble import SimulatedEnsemble
from tests.instruments.table_machine import CountedClock, InstantTable, home

LIMITS = TableLimits(rate_dps=300.0, acceleration_dps2=500.0)


@pytest.fixture
def table() -> InstantTable:
    return InstantTable()


@pytest.fixture(params=[False, True], ids=["as_it_is", "behind_bare_lines"])
def server(request: pytest.FixtureRequest, table: InstantTable) -> Iterator[SimulatedEnsemble]:
    with SimulatedEnsemble(table, bare_lines=request.param) as running:
        home("aerotech_ensemble", running.address)
        table.angle_deg = 350.0
        table.demands.clear()
        yield running


@pytest.fixture
def log() -> WireLog:
    return WireLog(size=1000)


@pytest.fixture
def driver(server: SimulatedEnsemble, log: WireLog) -> Iterator[Ensemble]:
    with Ensemble(server.address, clock=CountedClock(), wire_log=log) as driver:
        yield driver


@pytest.fixture
def enabled(driver: Ensemble, table: InstantTable) -> Ensemble:
    driver.set_limits(LIMITS)
    driver.enable()
    table.demands.clear()
    return driver


def sent(log: WireLog) -> list[str]:
    """The commands that went over the wire, without queries."""
    lines = [entry.data.decode().rstrip("\n") for entry in log.last(1000) if entry.direction == "sent"]
    return [line for line in lines if "(" not in line]


def test_it_is_a_rate_table_that_says_nothing_about_itself(driver: Ensemble) -> None:
    as_interface: RateTable = driver
    assert as_interface.identify() == Identity()


def test_it_starts_disabled_and_enabling_holds_it_still(driver: Ensemble, table: InstantTable) -> None:
    assert driver.state() is TableState.DISABLED
    driver.enable()
    assert driver.state() is TableState.AT_REST
    assert table.demands == [("close",), ("rate", 0.0)]


def test_everything_it_commands_byte_for_byte(driver: Ensemble, log: WireLog) -> None:
    driver.set_limits(LIMITS)
    driver.enable()
    driver.go_to_rate(20.0)
    driver.go_to_angle(0.0)
    driver.stop()
    driver.disable()
    assert sent(log) == [
        "RAMP MODE @0 RATE",
        "RAMP RATE @0 500.000000",
        "RAMP RATE 500.000000",
        "SETPARM @0, 73, 500.000000",
        "ENABLE @0",
        "ABORT @0",
        "FREERUN @0 -20.000000",
        "ABORT @0",
        "WAIT MODE NOWAIT",
        "INC",
        "LINEAR @0 -10.000000 F300.000000",
        "ABORT @0",
        "DISABLE @0",
    ]


def test_a_rate_is_counter_clockwise_and_read_back_so(enabled: Ensemble, table: InstantTable) -> None:
    enabled.go_to_rate(-123.456)
    assert table.rate_dps == pytest.approx(-123.456)
    reading = enabled.read()
    assert (reading.angle_deg, reading.rate_dps) == (350.0, -123.456)
    assert math.isnan(reading.acceleration_dps2)
    assert enabled.state() is TableState.MOVING


def test_a_stage_that_counts_counter_clockwise_is_driven_the_other_way(
    server: SimulatedEnsemble, table: InstantTable
) -> None:
    with Ensemble(server.address, clock=CountedClock(), clockwise=False) as driver:
        driver.set_limits(LIMITS)
        driver.enable()
        driver.go_to_rate(10.0)
        assert table.rate_dps == -10.0
        assert driver.read().rate_dps == 10.0


def test_a_rate_follows_a_rate_without_a_stop(enabled: Ensemble, table: InstantTable) -> None:
    enabled.go_to_rate(100.0)
    enabled.go_to_rate(-100.0)
    enabled.go_to_rate(0.0)
    assert table.demands == [("rate", 100.0), ("rate", -100.0), ("rate", 0.0)]
    assert enabled.state() is TableState.AT_REST


def test_an_angle_where_it_stands_already_needs_no_move(enabled: Ensemble, table: InstantTable) -> None:
    enabled.go_to_angle(-10.0)
    assert table.demands == []


def test_a_turning_table_is_brought_to_rest_before_an_angle(enabled: Ensemble, table: InstantTable) -> None:
    enabled.go_to_rate(100.0)
    enabled.go_to_angle(0.0)
    assert [demand[0] for demand in table.demands] == ["rate", "rate", "angle"]
    assert table.demands[1] == ("rate", 0.0)


def test_an_acceleration_beyond_the_drive_s_is_refused_by_name(driver: Ensemble) -> None:
    with pytest.raises(
        InstrumentError, match=r"sent 'RAMP RATE @0 9000.000000', expected %, got '!'.*check the axis, the limits"
    ):
        driver.set_limits(TableLimits(rate_dps=300.0, acceleration_dps2=9000.0))


def test_a_disabled_table_does_not_move_and_can_be_stopped(driver: Ensemble, table: InstantTable) -> None:
    driver.set_limits(LIMITS)
    driver.stop()
    with pytest.raises(InstrumentError, match=r"got '#'; no fault is reported; check that the axis is enabled"):
        driver.go_to_rate(1.0)
    assert table.demands == []


def test_an_emergency_stop_is_explained_and_cleared_by_enabling(enabled: Ensemble, server: SimulatedEnsemble) -> None:
    enabled.go_to_rate(20.0)
    server.open_interlock()
    assert enabled.state() is TableState.FAULT
    moves: list[Callable[[], None]] = [
        enabled.stop,
        enabled.enable,
        lambda: enabled.go_to_rate(1.0),
        lambda: enabled.go_to_angle(1.0),
    ]
    for move in moves:
        with pytest.raises(InstrumentError, match=r"fault 0x800 \(emergency stop\); remove the cause") as caught:
            move()
        assert "\n" not in str(caught.value)
    assert enabled.read().rate_dps == 0.0

    server.close_interlock()
    assert enabled.state() is TableState.FAULT
    enabled.enable()
    assert enabled.state() is TableState.AT_REST


def test_a_rate_that_runs_away_is_seen(enabled: Ensemble, table: InstantTable) -> None:
    enabled.go_to_rate(100.0)
    table.rate_dps = 1200.0
    assert enabled.state() is TableState.FAULT
    with pytest.raises(InstrumentError, match="velocity error"):
        enabled.stop()


def test_a_rate_that_trips_the_drive_is_an_error_although_it_was_acknowledged(
    driver: Ensemble, table: InstantTable
) -> None:
    driver.set_limits(TableLimits(rate_dps=5000.0, acceleration_dps2=500.0))
    driver.enable()
    with pytest.raises(
        InstrumentError, match=r"a rate of 2000 deg/s was commanded: fault 0x400 \(commanded velocity above"
    ):
        driver.go_to_rate(2000.0)
    assert table.rate_dps == 0.0


def test_a_cut_link_is_no_matter_between_two_exchanges(enabled: Ensemble, server: SimulatedEnsemble) -> None:
    enabled.go_to_rate(20.0)
    server.cut_connections()
    assert enabled.read().rate_dps == 20.0
    server.cut_connections()
    enabled.go_to_rate(30.0)
    assert enabled.read().rate_dps == 30.0


def test_an_angle_is_refused_until_the_axis_is_homed(server: SimulatedEnsemble, enabled: Ensemble) -> None:
    server.restart()
    enabled.enable()
    with pytest.raises(InstrumentError, match=r"the axis is not homed: .* home it \(the step Home, or HOME"):
        enabled.go_to_angle(10.0)
    enabled.go_to_rate(10.0)  # needs no home
    enabled.stop()
    home("aerotech_ensemble", server.address)
    enabled.enable()
    enabled.go_to_angle(10.0)
    assert enabled.read().angle_deg == pytest.approx(10.0)
