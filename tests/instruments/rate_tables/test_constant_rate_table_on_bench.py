"""Tables without a sinusoid: the driver, the wire and the simulated table's own dynamics together."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from benchctl_instruments.catalog import driver, twin
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.interfaces import Homes, RateTable, TableLimits, TableState
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.world import World
from tests.instruments.table_machine import home

TWINS: dict[str, dict[str, bool]] = {"aerotech_ensemble": {"bare_lines": True}, "newport_esp301": {}}


@pytest.fixture(params=TWINS)
def model(request: pytest.FixtureRequest) -> str:
    found: str = request.param
    return found


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def world(clock: VirtualClock) -> World:
    return World(clock)


@pytest.fixture
def server(model: str, world: World) -> Iterator[Any]:
    with twin("rate_table", model)(world.table, **TWINS[model]) as running:
        home(model, running.address)
        yield running


@pytest.fixture
def table(model: str, server: Any, clock: VirtualClock) -> Iterator[RateTable]:
    with driver("rate_table", model)(server.address, clock=clock) as table:
        table.set_limits(TableLimits(rate_dps=300.0, acceleration_dps2=500.0))
        table.enable()
        yield table


def test_a_rate_is_reached_within_the_acceleration_limit(table: RateTable, clock: VirtualClock) -> None:
    before_s = clock.now()
    table.go_to_rate(250.0)
    assert clock.now() == before_s
    clock.sleep(0.1)  # of the 0.5 s that 250 deg/s take at 500 deg/s²
    assert 20.0 < table.read().rate_dps < 80.0
    clock.sleep(2.0)
    assert table.read().rate_dps == pytest.approx(250.0, rel=1e-3)
    assert table.state() is TableState.MOVING
    table.stop()
    clock.sleep(0.1)
    assert 180.0 < table.read().rate_dps < 235.0
    assert table.state() is TableState.MOVING
    clock.sleep(2.0)
    assert table.state() is TableState.AT_REST


def test_what_the_driver_says_is_what_the_table_does(table: RateTable, world: World, clock: VirtualClock) -> None:
    table.go_to_rate(-40.0)
    clock.sleep(3.0)
    motion, reading = world.table.motion(), table.read()
    assert motion.rate_dps == pytest.approx(-40.0, rel=1e-3)
    assert reading.rate_dps == pytest.approx(motion.rate_dps, abs=1e-3)
    assert reading.angle_deg == pytest.approx(motion.angle_deg % 360.0, abs=1e-3)


@pytest.mark.parametrize("model", ["aerotech_ensemble"])
def test_the_direction_is_changed_in_motion(table: RateTable, clock: VirtualClock) -> None:
    table.go_to_rate(100.0)
    clock.sleep(2.0)
    before_s = clock.now()
    table.go_to_rate(-100.0)
    assert clock.now() == before_s
    clock.sleep(2.0)
    assert table.read().rate_dps == pytest.approx(-100.0, rel=1e-3)


@pytest.mark.parametrize("model", ["newport_esp301"])
def test_before_the_other_direction_the_table_comes_to_rest_and_the_same_one_is_changed_in_motion(
    table: RateTable, clock: VirtualClock
) -> None:
    table.go_to_rate(100.0)
    clock.sleep(2.0)
    before_s = clock.now()
    table.go_to_rate(50.0)
    assert clock.now() == before_s
    clock.sleep(2.0)
    assert table.read().rate_dps == pytest.approx(50.0, rel=1e-3)
    before_s = clock.now()
    table.go_to_rate(-100.0)
    assert 0.05 < clock.now() - before_s < 1.0  # 50 deg/s take 0.1 s
    assert table.read().rate_dps == pytest.approx(0.0, abs=1.0)
    clock.sleep(2.0)
    assert table.read().rate_dps == pytest.approx(-100.0, rel=1e-3)


def test_an_angle_past_the_seam_is_reached_without_a_turn(table: RateTable, clock: VirtualClock) -> None:
    for angle_deg in (350.0, 10.0):
        table.go_to_angle(angle_deg)
        assert table.state() is TableState.MOVING
        clock.sleep(5.0)
        assert table.read().angle_deg == pytest.approx(angle_deg, abs=0.01)
        assert table.state() is TableState.AT_REST


def test_between_a_rate_and_an_angle_the_table_comes_to_rest(table: RateTable, clock: VirtualClock) -> None:
    table.go_to_rate(200.0)
    clock.sleep(2.0)
    table.go_to_angle(90.0)
    clock.sleep(0.3)
    table.go_to_rate(30.0)
    clock.sleep(2.0)
    assert table.read().rate_dps == pytest.approx(30.0, rel=1e-3)
    table.go_to_angle(45.0)
    clock.sleep(5.0)
    assert table.read().angle_deg == pytest.approx(45.0, abs=0.01)


def test_an_emergency_stop_in_motion_lets_the_table_run_out(table: RateTable, server: Any, clock: VirtualClock) -> None:
    table.go_to_rate(100.0)
    clock.sleep(2.0)
    server.open_interlock()
    assert table.state() is TableState.FAULT
    assert table.read().rate_dps > 90.0
    clock.sleep(5.0)
    assert table.read().rate_dps == pytest.approx(0.0, abs=0.01)
    server.close_interlock()
    table.enable()
    assert table.state() is TableState.AT_REST


@pytest.mark.parametrize("at_home", [False, True])
def test_it_homes_slowly_and_counts_from_there(
    table: RateTable, world: World, clock: VirtualClock, at_home: bool
) -> None:
    assert isinstance(table, Homes)
    if not at_home:
        table.go_to_angle(70.0)
        clock.sleep(5.0)
    rates: list[float] = []

    def meanwhile() -> None:
        clock.sleep(0.1)
        rates.append(abs(world.table.motion().rate_dps))

    table.home(meanwhile)
    assert max(rates) == pytest.approx(0.0 if at_home else 10.0, abs=0.5)
    assert table.state() is TableState.AT_REST
    assert (world.table.motion().angle_deg + 180.0) % 360.0 == pytest.approx(180.0, abs=0.01)
    assert (table.read().angle_deg + 180.0) % 360.0 == pytest.approx(180.0, abs=0.02)
    table.go_to_rate(50.0)  # the rates and ramps of other motions are as before
    clock.sleep(1.0)
    assert table.read().rate_dps == pytest.approx(50.0, rel=1e-2)


def test_homing_that_is_ended_leaves_a_table_that_stops(table: RateTable, clock: VirtualClock) -> None:
    assert isinstance(table, Homes)
    table.go_to_angle(70.0)
    clock.sleep(5.0)

    def meanwhile() -> None:
        clock.sleep(0.5)
        raise RuntimeError

    with pytest.raises(RuntimeError):
        table.home(meanwhile)
    assert table.state() is TableState.MOVING
    table.stop()
    clock.sleep(1.0)
    assert table.state() is TableState.AT_REST
    assert 50.0 < table.read().angle_deg < 70.0


def test_a_table_that_meets_an_emergency_stop_while_it_homes_is_told(
    table: RateTable, server: Any, clock: VirtualClock
) -> None:
    assert isinstance(table, Homes)
    table.go_to_angle(70.0)
    clock.sleep(5.0)

    def meanwhile() -> None:
        clock.sleep(0.5)
        server.open_interlock()

    with pytest.raises(InstrumentError, match=r"homing was commanded: .*remove the cause"):
        table.home(meanwhile)
