"""The Watlow F4T by SCPI: the driver against its simulated controller, byte for byte, and programs of others."""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator
from typing import Any

import pytest

from benchctl_instruments.chambers.watlow_f4t_scpi import WatlowF4TScpi
from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.interfaces import Chamber, Identity
from benchctl_instruments.links.address import parse_address
from benchctl_instruments.simulated.watlow_f4t_scpi import SimulatedWatlowF4TScpi
from tests.instruments.chamber_machine import FakeChamber, InstantClock
from tests.instruments.wire_transcript import Transcript


@pytest.fixture
def machine() -> FakeChamber:
    return FakeChamber()


@pytest.fixture
def twin(machine: FakeChamber) -> Iterator[SimulatedWatlowF4TScpi]:
    with SimulatedWatlowF4TScpi(machine) as twin:
        yield twin


@pytest.fixture
def chamber(twin: SimulatedWatlowF4TScpi) -> Iterator[WatlowF4TScpi]:
    with WatlowF4TScpi(twin.address, clock=InstantClock()) as chamber:
        yield chamber


def test_it_reads_sets_starts_and_stops(chamber: WatlowF4TScpi, machine: FakeChamber) -> None:
    as_chamber: Chamber = chamber
    assert as_chamber.identify() == Identity(
        manufacturer="WATLOW ELECTRIC", model="F4T SIMULATED", serial="1", firmware="1.0"
    )
    machine.air = -40.04
    as_chamber.set_limits(-60.0, 85.0)
    as_chamber.go_to(-12.345678)
    assert (machine.setpoint, machine.on) == (-12.3, False)
    as_chamber.start()
    reading = as_chamber.read()
    assert (reading.temperature_c, reading.setpoint_c, reading.alarms) == (-40.04, -12.3, ())
    assert math.isnan(reading.power_percent)
    as_chamber.stop()
    assert (machine.setpoint, machine.on, machine.switched) == (-12.3, False, 2)


def test_each_command_is_read_back_byte_for_byte(twin: SimulatedWatlowF4TScpi) -> None:
    transcript = Transcript()
    with WatlowF4TScpi(twin.address, clock=InstantClock(), wire_log=transcript.log) as chamber:
        chamber.go_to(30.0)
        chamber.start()
    assert [bytes.fromhex(line[2:]) for line in transcript.lines] == [
        *[b":UNIT:TEMPERATURE?\n", b"C\n", b":SOURCE:CLOOP1:SPOINT?\n", b"20.00\n", b":OUTPUT1:STATE?\n", b"OFF\n"],
        *[b":SOURCE:CLOOP1:SPOINT 30.0\n", b":SOURCE:CLOOP1:SPOINT?\n", b"30.00\n"],
        *[b":PROGRAM:SELECTED:STATE?\n", b"IDLE\n"],
        *[b":OUTPUT1:STATE ON\n", b":OUTPUT1:STATE?\n", b"ON\n"],
    ]


def test_a_set_point_outside_the_limits_and_one_that_is_not_kept_are_errors(
    chamber: WatlowF4TScpi, machine: FakeChamber
) -> None:
    chamber.set_limits(-10.0, 200.0)
    with pytest.raises(UsageError, match="set point -20 °C lies outside the limits -10 to 200 °C"):
        chamber.go_to(-20.0)
    with pytest.raises(InstrumentError, match="it acknowledged set point 199 °C, and still reads set point 20 °C"):
        chamber.go_to(199.0)
    assert machine.setpoint == 20.0


def test_a_profile_is_refused_and_a_chamber_that_stopped_is_an_alarm(
    chamber: WatlowF4TScpi, twin: SimulatedWatlowF4TScpi, machine: FakeChamber
) -> None:
    for state in ("RUN", "HOLD", "RUNNING", "PAUSED"):
        twin.controller.profile = state
        with pytest.raises(InstrumentError, match="it runs a program and would not keep our set point"):
            chamber.start()
    twin.controller.profile = "IDLE"
    chamber.start()
    machine.on = False
    assert chamber.read().alarms == ("conditioning is off although it was switched on: the chamber's panel shows why",)


def test_a_controller_in_fahrenheit_is_refused_when_it_is_opened(twin: SimulatedWatlowF4TScpi) -> None:
    twin.controller.unit = "F"
    with pytest.raises(InstrumentError, match="its temperatures are in °F; set the unit of its communication to °C"):
        WatlowF4TScpi(twin.address, clock=InstantClock()).open()


@pytest.mark.parametrize("options", [{"loop": 5}, {"on_by": "key"}, {"on_number": 0}])
def test_options_that_an_f4t_does_not_have_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="expected a loop of 1 to 4, one of output, nothing, and an output of 1 to 8"):
        WatlowF4TScpi("tcp://127.0.0.1:1", clock=InstantClock(), **options)


def test_a_chamber_that_nothing_switches_conditions_always(machine: FakeChamber) -> None:
    with (
        SimulatedWatlowF4TScpi(machine, loop=2, on_by="nothing") as twin,
        WatlowF4TScpi(twin.address, clock=InstantClock(), loop=2, on_by="nothing") as chamber,
    ):
        chamber.start()
        chamber.stop()
        assert (machine.on, machine.switched) == (True, 1)


TE107_CONTROL = """
*IDN? -> WATLOW ELECTRIC,F4T SIMULATED,1,1.0
:UNITS:TEMPERATURE C
:UNIT:TEMPERATURE? -> C
SOURCE:CLOOP1:SPOINT 5
:SOURCE:CLOOP1:SPOINT? -> 5.00
:SOURCE:CLOOP1:PVALUE? -> 23.00
:OUTPUT1:STATE ON
:OUTPUT1:STATE? -> ON
:PROGRAM:SELECTED:STATE START
:PROGRAM:SELECTED:STATE? -> RUN
:PROGRAM:SELECTED:STATE STOP
"""

PY_LAB_HAL = """
:SOURCE:CLOOP1:SPOINT 100.00
:SOURCE:CLOOP1:SPOINT? -> 100.00
:SOURCE:CLOOP1:PVALUE? -> 23.00
"""


@pytest.mark.parametrize(
    "dialogue",
    [
        pytest.param(TE107_CONTROL, id="DAsh0244/te107_control f4t_control.py"),
        pytest.param(PY_LAB_HAL, id="google/py-lab-hal testequity107.py"),
    ],
)
@pytest.mark.foreign_client("watlow_f4t_scpi", "", "its commands, each answer checked")
def test_a_public_clients_dialogue_is_answered_as_it_needs(twin: SimulatedWatlowF4TScpi, dialogue: str) -> None:
    where = parse_address(twin.address)
    with socket.create_connection((where.host, where.port), timeout=10.0) as wire, wire.makefile("rb") as answers:
        for line in dialogue.strip().splitlines():
            sent, arrow, wanted = line.partition(" -> ")
            wire.sendall(f"{sent}\n".encode())
            if arrow:
                assert answers.readline() == f"{wanted}\n".encode(), sent
