"""The P-300's driver, its wire and the simulated chamber's own dynamics together, and faults on the wire."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from benchctl_instruments.chambers.espec_p300 import EspecP300
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.espec_p300 import SimulatedEspecP300
from benchctl_instruments.simulated.faults.bench import BenchFaults
from benchctl_instruments.simulated.faults.link_faults import LinkFault, Refusal, Silence
from benchctl_instruments.simulated.world import World


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def driver(clock: VirtualClock) -> Iterator[EspecP300]:
    with (
        SimulatedEspecP300(World(clock).chamber) as twin,
        EspecP300(twin.address, clock=clock) as driver,
    ):
        driver.set_limits(-55.0, 85.0)
        yield driver


def test_the_air_goes_to_the_highest_set_point_without_an_alarm(driver: EspecP300, clock: VirtualClock) -> None:
    driver.go_to(85.0)
    clock.sleep(1800.0)
    assert driver.read().temperature_c == pytest.approx(23.0, abs=1.0)  # it stands by
    driver.start()
    clock.sleep(600.0)
    on_the_way = driver.read()
    assert 30.0 < on_the_way.temperature_c < 60.0
    assert on_the_way.power_percent > 0.0
    clock.sleep(4 * 3600.0)
    arrived = driver.read()
    assert (arrived.temperature_c, arrived.setpoint_c, arrived.alarms) == (85.0, 85.0, ())


def with_fault(clock: VirtualClock, fault: LinkFault) -> SimulatedEspecP300:
    twin = SimulatedEspecP300(World(clock).chamber)
    BenchFaults([fault], clock.now).befall("chamber", twin)
    return twin


def test_an_answer_that_is_lost_costs_a_question_and_nothing_else(clock: VirtualClock) -> None:
    with (
        with_fault(clock, Silence(on="chamber", pattern="^TEMP, S", nth=1)) as twin,
        EspecP300(twin.address, clock=clock, timeout_s=0.5) as driver,
    ):
        driver.go_to(40.0)
        assert driver.read().setpoint_c == 40.0


def test_a_refusal_that_passes_is_waited_for(clock: VirtualClock) -> None:
    with (
        with_fault(clock, Refusal(on="chamber", pattern=r"^MODE\?", nth=1)) as twin,
        EspecP300(twin.address, clock=clock) as driver,
    ):
        driver.start()
        assert twin.controller.execute("MODE?") == "CONSTANT"


def test_a_refusal_that_lasts_is_told(clock: VirtualClock) -> None:
    with (
        with_fault(clock, Refusal(on="chamber", pattern=r"^MODE\?", every=1)) as twin,
        EspecP300(twin.address, clock=clock) as driver,
        pytest.raises(InstrumentError, match=r"'MODE\?' was refused for 5.0 s with 'NA:CHB NOT READY'"),
    ):
        driver.start()
