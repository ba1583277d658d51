"""The driver, the wire and the simulated table's own dynamics together."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from benchctl_instruments.interfaces import TableLimits, TableState
from benchctl_instruments.rate_tables.acutrol3000 import Acutrol3000
from benchctl_instruments.simulated.acutrol3000 import SimulatedAcutrol3000
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.world import World


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def driver(clock: VirtualClock) -> Iterator[Acutrol3000]:
    with (
        SimulatedAcutrol3000(World(clock).table) as server,
        Acutrol3000(server.address, clock=clock) as driver,
    ):
        driver.set_limits(TableLimits(rate_dps=300.0, acceleration_dps2=500.0))
        driver.enable()
        yield driver


def test_a_rate_is_reached_within_the_acceleration_limit(driver: Acutrol3000, clock: VirtualClock) -> None:
    driver.go_to_rate(250.0)
    clock.sleep(0.1)  # of the 0.5 s that 250 deg/s take at 500 deg/s²
    assert 20.0 < driver.read().rate_dps < 80.0
    clock.sleep(2.0)
    assert driver.read().rate_dps == pytest.approx(250.0, rel=1e-3)
    driver.stop()
    clock.sleep(2.0)
    assert driver.state() is TableState.AT_REST


def test_an_angle_past_the_seam_is_reached_without_a_turn(driver: Acutrol3000, clock: VirtualClock) -> None:
    for angle_deg in (350.0, 10.0):
        driver.go_to_angle(angle_deg)
        clock.sleep(5.0)
        assert driver.read().angle_deg == pytest.approx(angle_deg, abs=0.01)
        assert driver.state() is TableState.AT_REST


def test_an_oscillation_peaks_at_the_demanded_rate_after_two_periods(driver: Acutrol3000, clock: VirtualClock) -> None:
    def peak_dps(periods: float) -> float:
        rates = []
        for _ in range(round(periods * 100)):
            clock.sleep(0.02)
            rates.append(abs(driver.read().rate_dps))
        return max(rates)

    driver.oscillate(amplitude_dps=100.0, frequency_hz=0.5)
    assert peak_dps(1.0) < 60.0
    peak_dps(2.0)
    assert peak_dps(2.0) == pytest.approx(100.0, rel=0.01)
