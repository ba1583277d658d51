"""What every table without a sinusoid does alike, over its wire."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from benchctl_instruments.catalog import driver, models, oscillates, twin
from benchctl_instruments.errors import UsageError
from benchctl_instruments.interfaces import Clock, RateTable, TableLimits, TableState
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.machines import TableMachine
from benchctl_instruments.simulated.world import World
from tests.instruments.table_machine import CountedClock, InstantTable, home

LIMITS = TableLimits(rate_dps=300.0, acceleration_dps2=500.0)


@pytest.fixture(params=["aerotech_ensemble", "newport_esp301"])
def model(request: pytest.FixtureRequest) -> str:
    found: str = request.param
    return found


@pytest.fixture
def log() -> WireLog:
    return WireLog(size=1000)


@pytest.fixture
def machine() -> InstantTable:
    return InstantTable()


@pytest.fixture
def table(model: str, machine: InstantTable, log: WireLog) -> Iterator[RateTable]:
    """One that does at once what is demanded of it."""
    for table in on_the_wire(model, machine, CountedClock(), wire_log=log):
        machine.angle_deg = 350.0
        machine.demands.clear()
        yield table


@pytest.fixture
def enabled(table: RateTable, machine: InstantTable) -> RateTable:
    table.set_limits(LIMITS)
    table.enable()
    machine.demands.clear()
    return table


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def world(clock: VirtualClock) -> World:
    return World(clock)


@pytest.fixture
def true_table(model: str, world: World, clock: VirtualClock) -> Iterator[RateTable]:
    """One with dynamics of its own."""
    for table in on_the_wire(model, world.table, clock):
        table.set_limits(LIMITS)
        table.enable()
        yield table


def on_the_wire(model: str, machine: TableMachine, clock: Clock, **options: Any) -> Iterator[RateTable]:
    with (
        twin("rate_table", model)(machine) as server,
        driver("rate_table", model)(server.address, clock=clock, **options) as table,
    ):
        table.close()
        home(model, server.address)
        table.open()
        yield table


def test_the_catalog_knows_without_an_instrument_which_tables_have_a_sinusoid() -> None:
    assert {model: oscillates(model) for model in models("rate_table")} == {
        "acutrol3000": True,
        "aerotech_ensemble": False,
        "manual": False,
        "newport_esp301": False,
    }


@pytest.mark.parametrize("unknown", ["acme_9000", "table.toml", ""])
def test_of_a_table_of_which_nothing_is_known_no_objection_is_raised(unknown: str) -> None:
    assert oscillates(unknown)


def test_an_oscillation_is_refused_with_what_can_run_instead(enabled: RateTable, machine: InstantTable) -> None:
    with pytest.raises(UsageError, match=r"no public source describes one.*sine_sweep.*take one of constant rates"):
        enabled.oscillate(10.0, 1.0)
    assert machine.demands == []


@pytest.mark.parametrize(("angle_deg", "reached_deg"), [(10.0, 370.0), (300.0, 300.0), (-20.0, 340.0), (1085.0, 365.0)])
def test_an_angle_is_reached_the_short_way_round(
    enabled: RateTable, machine: InstantTable, angle_deg: float, reached_deg: float
) -> None:
    enabled.go_to_angle(angle_deg)
    assert [demand[1] for demand in machine.demands if demand[0] == "angle"] == pytest.approx([reached_deg])
    assert enabled.state() is TableState.AT_REST


def test_limits_are_programmed_and_the_rate_s_is_kept_by_the_driver(enabled: RateTable, machine: InstantTable) -> None:
    enabled.go_to_rate(100.0)
    assert machine.limits() == (1000.0, 500.0)
    enabled.go_to_angle(0.0)
    assert machine.limits() == (300.0, 500.0)
    machine.demands.clear()
    with pytest.raises(UsageError, match=r"commanded 301 deg/s, the limit that was set is 300 deg/s"):
        enabled.go_to_rate(301.0)
    assert machine.demands == []


def test_nothing_moves_before_limits_are_set(table: RateTable, machine: InstantTable) -> None:
    table.enable()
    machine.demands.clear()
    moves: list[Callable[[], None]] = [lambda: table.go_to_rate(1.0), lambda: table.go_to_angle(1.0)]
    for move in moves:
        with pytest.raises(UsageError, match=r"before its limits were set"):
            move()
    assert machine.demands == []


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_numbers_that_mean_nothing_never_reach_the_wire(enabled: RateTable, log: WireLog, bad: float) -> None:
    before = len(log.last(1000))
    calls: list[Callable[[], None]] = [
        lambda: enabled.go_to_rate(bad),
        lambda: enabled.go_to_angle(bad),
        lambda: enabled.set_limits(TableLimits(rate_dps=bad, acceleration_dps2=1.0)),
        lambda: enabled.set_limits(TableLimits(rate_dps=1.0, acceleration_dps2=0.0)),
    ]
    for call in calls:
        with pytest.raises(UsageError, match="expected a finite number"):
            call()
    assert len(log.last(1000)) == before


def test_a_moving_table_is_not_disabled(enabled: RateTable, machine: InstantTable) -> None:
    enabled.go_to_rate(5.0)
    with pytest.raises(UsageError, match=r"turns at 5.000 deg/s; stop it before"):
        enabled.disable()
    assert enabled.state() is TableState.MOVING
    enabled.stop()
    enabled.disable()
    assert enabled.state() is TableState.DISABLED
    assert machine.demands[-1] == ("open",)


def test_the_acceleration_is_what_its_reads_prove(true_table: RateTable, world: World, clock: VirtualClock) -> None:
    assert math.isnan(true_table.read().acceleration_dps2)
    for rate_dps, sign in ((150.0, 1.0), (0.0, -1.0)):
        true_table.go_to_rate(rate_dps)
        clock.sleep(0.15)
        true_table.read()
        clock.sleep(0.05)
        assert world.table.motion().acceleration_dps2 == pytest.approx(sign * 500.0, rel=0.02)
        assert 480.0 < sign * true_table.read().acceleration_dps2 <= 505.0
        clock.sleep(3.0)
        true_table.read()
        clock.sleep(0.05)
        assert true_table.read().acceleration_dps2 == 0.0


def test_on_a_new_connection_reads_begin_anew(true_table: RateTable, clock: VirtualClock) -> None:
    true_table.read()
    true_table.close()
    clock.sleep(1.0)
    true_table.open()
    assert math.isnan(true_table.read().acceleration_dps2)
    assert true_table.state() is TableState.AT_REST
