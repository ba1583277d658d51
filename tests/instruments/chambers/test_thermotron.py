"""The Thermotron drivers against their simulated controllers, over TCP and over a real serial line."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator

import pytest

from benchctl_instruments.chambers.thermotron import Thermotron
from benchctl_instruments.chambers.thermotron_3800 import Thermotron3800
from benchctl_instruments.chambers.thermotron_8800 import Thermotron8800
from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.interfaces import Chamber, Identity
from benchctl_instruments.links.lines import NoAnswerError
from benchctl_instruments.simulated.thermotron_3800 import SimulatedThermotron3800
from benchctl_instruments.simulated.thermotron_8800 import SimulatedThermotron8800
from tests.instruments.chamber_machine import FakeChamber, InstantClock

SERIAL = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")
LINES = [("8800", True), ("3800", True), pytest.param(("8800", False), marks=SERIAL)]
LINES += [pytest.param(("3800", False), marks=SERIAL)]


@pytest.fixture
def machine() -> FakeChamber:
    return FakeChamber()


@pytest.fixture(params=LINES, ids=str)
def chamber(machine: FakeChamber, request: pytest.FixtureRequest) -> Iterator[Thermotron]:
    model, over_tcp = request.param
    make_twin, make = (
        (SimulatedThermotron8800, Thermotron8800) if model == "8800" else (SimulatedThermotron3800, Thermotron3800)
    )
    with make_twin(machine, over_tcp=over_tcp) as twin, make(twin.address, clock=InstantClock()) as chamber:
        yield chamber


@pytest.fixture
def twin_8800(machine: FakeChamber) -> Iterator[SimulatedThermotron8800]:
    with SimulatedThermotron8800(machine) as twin:
        yield twin


@pytest.fixture
def twin_3800(machine: FakeChamber) -> Iterator[SimulatedThermotron3800]:
    with SimulatedThermotron3800(machine, over_tcp=True) as twin:
        yield twin


def test_it_reads_sets_starts_and_stops(chamber: Thermotron, machine: FakeChamber) -> None:
    as_chamber: Chamber = chamber
    machine.air = -40.04
    as_chamber.set_limits(-60.0, 85.0)
    reading = as_chamber.read()
    assert (reading.temperature_c, reading.setpoint_c, reading.alarms) == (-40.04, 20.0, ())
    as_chamber.go_to(-12.345678)
    assert (machine.setpoint, machine.on) == (20.0, False)
    as_chamber.start()
    assert (machine.setpoint, machine.on) == (-12.3, True)
    as_chamber.go_to(40.0)
    assert as_chamber.read().setpoint_c == machine.setpoint == 40.0
    seen = []
    for switch in (as_chamber.start, as_chamber.stop, as_chamber.stop, as_chamber.start):
        switch()
        seen.append(machine.on)
    assert (seen, machine.switched, machine.setpoint) == ([True, False, False, True], 3, 40.0)


def test_a_set_point_beyond_the_limits_is_refused_before_anything_is_sent(
    chamber: Thermotron, machine: FakeChamber
) -> None:
    chamber.start()
    chamber.set_limits(-10.0, 60.0)
    for wrong in (60.1, -10.1, math.nan, math.inf):
        with pytest.raises(UsageError, match=f"set point {wrong:g} °C lies outside the limits -10 to 60 °C"):
            chamber.go_to(wrong)
    assert machine.setpoint == 20.0


def test_a_chamber_that_stops_by_itself_is_an_alarm_until_it_is_stopped(
    twin_3800: SimulatedThermotron3800,
) -> None:
    with Thermotron3800(twin_3800.address, clock=InstantClock()) as chamber:
        chamber.start()
        assert chamber.read().alarms == ()
        twin_3800.controller.stop_by_itself()
        (alarm,) = chamber.read().alarms
        assert alarm == "conditioning is off although it was switched on: the chamber's panel shows why"
        chamber.stop()
        assert chamber.read().alarms == ()


def test_a_program_of_a_3800_is_refused_at_a_start_and_ended_by_a_stop(
    twin_3800: SimulatedThermotron3800, machine: FakeChamber
) -> None:
    with Thermotron3800(twin_3800.address, clock=InstantClock()) as chamber:
        twin_3800.controller.run_program()
        with pytest.raises(InstrumentError, match="it runs a program and would not keep our set point"):
            chamber.start()
        chamber.stop()
    assert (twin_3800.controller.program, machine.on) == (False, False)


def test_a_second_passes_after_every_command_of_a_3800(twin_3800: SimulatedThermotron3800) -> None:
    clock = InstantClock()
    with Thermotron3800(twin_3800.address, clock=clock) as chamber:
        chamber.go_to(30.0)
        assert clock.slept_s == 1.0
        chamber.start()
        assert clock.slept_s == 3.0  # the set point again, and RUNM


def test_an_8800_says_name_version_and_throttle(twin_8800: SimulatedThermotron8800, machine: FakeChamber) -> None:
    machine.power = -37.5
    with Thermotron8800(twin_8800.address, clock=InstantClock()) as chamber:
        expected = Identity(manufacturer="Thermotron", model="8800 SIMULATED", firmware="1.00")
        assert (chamber.identify(), chamber.read().power_percent) == (expected, -37.5)


def test_a_process_alarm_of_an_8800_is_told_with_the_cause_of_its_stop(
    twin_8800: SimulatedThermotron8800, machine: FakeChamber
) -> None:
    with Thermotron8800(twin_8800.address, clock=InstantClock()) as chamber:
        chamber.start()
        machine.air = 190.0
        assert chamber.read().alarms == (
            "high process alarm",
            "conditioning is off although it was switched on: a process alarm",
        )
        assert not machine.on


def test_an_old_stop_of_an_8800_is_no_alarm(twin_8800: SimulatedThermotron8800) -> None:
    twin_8800.controller.stop_code = 10
    with Thermotron8800(twin_8800.address, clock=InstantClock()) as chamber:
        assert chamber.read().alarms == ()
        chamber.start()
        twin_8800.controller.stop_by_itself()
        twin_8800.controller.stop_code = 10
        (alarm,) = chamber.read().alarms
        assert alarm.endswith("switched on: its Therm-Alarm tripped")


def test_the_ramp_is_written_at_the_start_and_only_if_it_is_asked_for(twin_8800: SimulatedThermotron8800) -> None:
    with Thermotron8800(twin_8800.address, clock=InstantClock()) as plain:
        plain.start()
        plain.stop()
    assert twin_8800.controller.execute("MRMP1?") == "0.000"
    with Thermotron8800(twin_8800.address, clock=InstantClock(), ramp_c_per_min=2.5) as chamber:
        chamber.start()
    assert twin_8800.controller.execute("MRMP1?") == "2.500"


def test_a_refused_command_of_an_8800_is_told_with_its_code(twin_8800: SimulatedThermotron8800) -> None:
    with Thermotron8800(twin_8800.address, clock=InstantClock()) as chamber:
        twin_8800.controller.run_program()
        with pytest.raises(InstrumentError, match=r"'SETP1,30\.0' was refused with code 1.* that no program runs"):
            chamber.go_to(30.0)


def test_neither_takes_the_other_for_its_own(
    twin_8800: SimulatedThermotron8800, twin_3800: SimulatedThermotron3800
) -> None:
    for wrong in (
        Thermotron3800(twin_8800.address, clock=InstantClock(), timeout_s=0.1),
        Thermotron8800(twin_3800.address, clock=InstantClock(), timeout_s=0.1),
    ):
        with pytest.raises(NoAnswerError, match=r"no answer within 0\.1 s"):
            wrong.open()
