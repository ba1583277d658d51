"""The driver, the wire and the simulated table's own dynamics together."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from instruments.interfaces import TableLimits, TableState
from instruments.rate_tables.newport_esp301 import Esp301
from instruments.simulated.clock import VirtualClock
from instruments.simulated.newport_esp301 import SimulatedEsp301
from instruments.simulated.world import World


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def world(clock: VirtualClock) -> World:
    return World(clock)


@pytest.fixture
def server(world: World) -> Iterator[SimulatedEsp301]:
    with SimulatedEsp301(world.table) as running:
        yield running


@pytest.fixture
def driver(server: SimulatedEsp301, clock: VirtualClock) -> Iterator[Esp301]:
    with Esp301(server.address, clock=clock) as driver:
        driver.set_limits(TableLimits(rate_dps=300.0, acceleration_dps2=500.0))
        driver.enable()
        yield driver


def test_a_rate_is_reached_within_the_acceleration_limit(driver: Esp301, clock: VirtualClock) -> None:
    before_s = clock.now()
    driver.go_to_rate(250.0)
    assert clock.now() == before_s
    clock.sleep(0.1)  # of the 0.5 s that 250 deg/s take at 500 deg/s²
    assert 20.0 < driver.read().rate_dps < 80.0
    clock.sleep(2.0)
    assert driver.read().rate_dps == pytest.approx(250.0, rel=1e-3)
    assert driver.state() is TableState.MOVING
    driver.stop()
    clock.sleep(0.1)
    assert 180.0 < driver.read().rate_dps < 235.0
    assert driver.state() is TableState.MOVING
    clock.sleep(2.0)
    assert driver.state() is TableState.AT_REST


def test_what_the_driver_says_is_what_the_table_does(driver: Esp301, world: World, clock: VirtualClock) -> None:
    driver.go_to_rate(-40.0)
    clock.sleep(3.0)
    motion, reading = world.table.motion(), driver.read()
    assert motion.rate_dps == pytest.approx(-40.0, rel=1e-3)
    assert reading.rate_dps == pytest.approx(motion.rate_dps, abs=1e-3)
    assert reading.angle_deg == pytest.approx(motion.angle_deg % 360.0, abs=1e-3)


def test_before_the_other_direction_the_table_comes_to_rest_and_the_same_one_is_changed_in_motion(
    driver: Esp301, clock: VirtualClock
) -> None:
    driver.go_to_rate(100.0)
    clock.sleep(2.0)
    before_s = clock.now()
    driver.go_to_rate(50.0)
    assert clock.now() == before_s
    clock.sleep(2.0)
    assert driver.read().rate_dps == pytest.approx(50.0, rel=1e-3)
    before_s = clock.now()
    driver.go_to_rate(-100.0)
    assert 0.05 < clock.now() - before_s < 1.0  # 50 deg/s take 0.1 s
    assert driver.read().rate_dps == pytest.approx(0.0, abs=1.0)
    clock.sleep(2.0)
    assert driver.read().rate_dps == pytest.approx(-100.0, rel=1e-3)


def test_an_angle_past_the_seam_is_reached_without_a_turn(driver: Esp301, clock: VirtualClock) -> None:
    for angle_deg in (350.0, 10.0):
        driver.go_to_angle(angle_deg)
        assert driver.state() is TableState.MOVING
        clock.sleep(5.0)
        assert driver.read().angle_deg == pytest.approx(angle_deg, abs=0.01)
        assert driver.state() is TableState.AT_REST


def test_between_a_rate_and_an_angle_the_table_comes_to_rest(driver: Esp301, clock: VirtualClock) -> None:
    driver.go_to_rate(200.0)
    clock.sleep(2.0)
    driver.go_to_angle(90.0)
    clock.sleep(0.3)
    driver.go_to_rate(30.0)
    clock.sleep(2.0)
    assert driver.read().rate_dps == pytest.approx(30.0, rel=1e-3)
    driver.go_to_angle(45.0)
    clock.sleep(5.0)
    assert driver.read().angle_deg == pytest.approx(45.0, abs=0.01)


def test_an_emergency_stop_in_motion_lets_the_table_run_out(
    driver: Esp301, server: SimulatedEsp301, clock: VirtualClock
) -> None:
    driver.go_to_rate(100.0)
    clock.sleep(2.0)
    server.open_interlock()
    assert driver.state() is TableState.FAULT
    assert driver.read().rate_dps > 90.0
    clock.sleep(5.0)
    assert driver.read().rate_dps == pytest.approx(0.0, abs=0.01)
    server.close_interlock()
    driver.enable()
    assert driver.state() is TableState.AT_REST
