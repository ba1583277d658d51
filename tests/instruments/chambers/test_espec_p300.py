"""The P-300 driver against its simulated twin, over TCP and over a real serial line."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator

import pytest

from benchctl_instruments.chambers.espec_p300 import EspecP300
from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Chamber, Identity
from benchctl_instruments.links.lines import NoAnswerError
from benchctl_instruments.simulated.espec_p300 import SimulatedEspecP300
from tests.instruments.chamber_machine import FakeChamber, InstantClock

SERIAL = pytest.param(True, marks=pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals"))


@pytest.fixture
def machine() -> FakeChamber:
    return FakeChamber()


@pytest.fixture(params=[False, SERIAL], ids=["tcp", "serial"])
def twin(machine: FakeChamber, request: pytest.FixtureRequest) -> Iterator[SimulatedEspecP300]:
    with SimulatedEspecP300(machine, over_tcp=not request.param) as twin:
        yield twin


@pytest.fixture
def chamber(twin: SimulatedEspecP300) -> Iterator[EspecP300]:
    with EspecP300(twin.address, clock=InstantClock()) as chamber:
        yield chamber


def test_it_is_a_chamber_that_says_who_it_is(chamber: EspecP300) -> None:
    as_chamber: Chamber = chamber
    assert as_chamber.identify() == Identity(manufacturer="ESPEC", model="P300", firmware="P300 SIMULATED 1.00")


def test_air_set_point_and_heater_are_read(chamber: EspecP300, machine: FakeChamber) -> None:
    machine.air, machine.setpoint, machine.power = -40.04, -55.5, -37.5
    reading = chamber.read()
    assert (reading.temperature_c, reading.setpoint_c, reading.power_percent) == (-40.0, -55.5, 0.0)
    machine.air, machine.power = 84.96, 12.34
    reading = chamber.read()
    assert (reading.temperature_c, reading.power_percent, reading.alarms) == (85.0, 12.3, ())


def test_a_set_point_goes_to_the_nearest_tenth_and_has_an_effect_once_it_is_started(
    chamber: EspecP300, machine: FakeChamber
) -> None:
    chamber.go_to(-12.345678)
    assert (machine.setpoint, machine.on) == (-12.3, False)
    chamber.start()
    assert machine.on
    chamber.go_to(40.0)
    assert chamber.read().setpoint_c == machine.setpoint == 40.0


def test_starting_and_stopping_twice_changes_nothing_more(chamber: EspecP300, machine: FakeChamber) -> None:
    seen = []
    for switch in (chamber.start, chamber.start, chamber.stop, chamber.stop):
        switch()
        seen.append(machine.on)
    assert seen == [True, True, False, False]
    assert (machine.switched, machine.setpoint) == (2, 20.0)


def test_a_set_point_beyond_the_alarms_is_refused_before_anything_is_written(
    chamber: EspecP300, machine: FakeChamber
) -> None:
    chamber.set_limits(-10.0, 60.0)
    for wrong in (60.1, -10.1, math.nan, math.inf):
        with pytest.raises(UsageError, match=f"set point {wrong:g} °C lies outside the controller's limits -10 to 60"):
            chamber.go_to(wrong)
    assert machine.setpoint == 20.0
    for right, arrives in ((60.0, 60.0), (60.04, 60.0), (-10.04, -10.0)):
        chamber.go_to(right)
        assert machine.setpoint == arrives


@pytest.mark.parametrize(
    ("low_c", "high_c", "setpoint_c"),
    [(-60.0, -50.0, -50.0), (100.5, 120.0, 100.5), (-75.0, 180.0, 20.0)],
)
def test_new_limits_arrive_with_a_set_point_within_them(
    chamber: EspecP300, machine: FakeChamber, low_c: float, high_c: float, setpoint_c: float
) -> None:
    chamber.set_limits(low_c, high_c)
    assert machine.setpoint == setpoint_c
    with pytest.raises(UsageError, match=f"limits {low_c:g} to {high_c:g} °C"):
        chamber.go_to(300.0)


@pytest.mark.parametrize(
    ("low_c", "high_c", "said"),
    [
        (50.0, 20.0, "set point limits 50 to 20 °C; give the lower one first"),
        (19.96, 20.04, "limits 19.96 to 20.04 °C; give the lower one first, 0.1 °C apart at least"),
        (math.nan, 20.0, "give the lower one first"),
        (-math.inf, 20.0, "give finite numbers"),
    ],
)
def test_limits_that_cannot_be_are_refused(chamber: EspecP300, low_c: float, high_c: float, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        chamber.set_limits(low_c, high_c)


def test_limits_beyond_the_chambers_own_range_are_refused_by_the_chamber(chamber: EspecP300) -> None:
    with pytest.raises(InstrumentError, match=r"'TEMP, S20.0 H400.0 L0.0' was refused with 'NA:DATA OUT OF RANGE'"):
        chamber.set_limits(0.0, 400.0)


def test_a_running_program_is_not_fought_with(
    chamber: EspecP300, twin: SimulatedEspecP300, machine: FakeChamber
) -> None:
    twin.controller.run_program("RUN PAUSE")
    with pytest.raises(InstrumentError, match="it runs a program and would not keep our set point; end the program"):
        chamber.start()
    with pytest.raises(
        InstrumentError, match=r"'TEMP, S30.0' was refused for 5.0 s with 'NA:CHB NOT READY': .*program"
    ):
        chamber.go_to(30.0)
    assert twin.controller.execute("MODE?,DETAIL") == "RUN PAUSE"
    chamber.stop()
    assert not machine.on


def test_protected_settings_are_told_with_what_to_do(
    chamber: EspecP300, twin: SimulatedEspecP300, machine: FakeChamber
) -> None:
    twin.controller.protected = True
    with pytest.raises(InstrumentError, match=r"with 'NA:PROTECT ON': .* lift the protection there$"):
        chamber.go_to(30.0)
    with pytest.raises(InstrumentError, match="'MODE,CONSTANT' was refused with 'NA:PROTECT ON'"):
        chamber.start()
    assert (machine.setpoint, machine.on) == (20.0, False)


def test_a_panel_that_is_off_is_left_off(chamber: EspecP300, twin: SimulatedEspecP300, machine: FakeChamber) -> None:
    twin.controller.execute("POWER,OFF")
    with pytest.raises(InstrumentError, match=r"'MODE,CONSTANT' was refused for 5.0 s .* switched off at the panel"):
        chamber.start()
    chamber.stop()
    assert twin.controller.execute("MODE?") == "OFF"


def test_alarms_come_with_their_codes_and_with_words_where_they_are_known(twin: SimulatedEspecP300) -> None:
    twin.controller.raise_alarm(12)
    twin.controller.raise_alarm(3)
    with EspecP300(twin.address, clock=InstantClock(), alarm_words={"12": "door open"}) as chamber:
        assert chamber.read().alarms == ("alarm 12 (door open)", "alarm 3 (see the chamber's manual)")


def test_air_beyond_the_limits_is_an_alarm(chamber: EspecP300, machine: FakeChamber) -> None:
    chamber.set_limits(-20.0, 60.0)
    chamber.start()
    machine.air = 60.5
    assert chamber.read().alarms == ("alarm 1 (see the chamber's manual)",)


def test_a_controller_that_does_not_do_what_it_said_ok_to_is_found_out(
    chamber: EspecP300, machine: FakeChamber, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "set_setpoint", lambda setpoint_c: None)
    with pytest.raises(
        InstrumentError, match=r"acknowledged set point -5 °C, and still reads set point 20 °C after 2 s; check that"
    ):
        chamber.go_to(-5.0)


@pytest.mark.parametrize("serial", [False, SERIAL])
def test_on_rs485_the_number_goes_before_every_line_and_another_one_is_silence(
    machine: FakeChamber, serial: bool
) -> None:
    with SimulatedEspecP300(machine, rs485_address=3, over_tcp=not serial) as twin:
        with EspecP300(twin.address, clock=InstantClock(), rs485_address=3) as chamber:
            chamber.go_to(30.0)
        for wrong in (4, None):
            with pytest.raises(NoAnswerError, match=r"P300.* at .*TYPE\?', no answer within 0.1 s; check power, cable"):
                EspecP300(twin.address, clock=InstantClock(), rs485_address=wrong, timeout_s=0.1).open()
    assert machine.setpoint == 30.0


def test_a_number_where_none_is_needed_is_said_by_the_chamber(twin: SimulatedEspecP300) -> None:
    with pytest.raises(InstrumentError, match=r"number 3, at .*'TYPE\?' was refused with 'NA:ADDR ERR': the command"):
        EspecP300(twin.address, clock=InstantClock(), rs485_address=3).open()
    with pytest.raises(UsageError, match="rs485_address = 0; give the chamber's number"):
        EspecP300(twin.address, clock=InstantClock(), rs485_address=0)


@pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")
def test_a_serial_line_as_slow_as_the_real_one_is_fast_enough(machine: FakeChamber) -> None:
    with (
        SimulatedEspecP300(machine, over_tcp=False, pace_baud=9600) as twin,
        EspecP300(twin.address, clock=InstantClock()) as chamber,
    ):
        chamber.go_to(30.0)
        assert chamber.read().setpoint_c == 30.0


def test_a_chamber_that_is_switched_off_and_on_is_found_again(machine: FakeChamber) -> None:
    twin = SimulatedEspecP300(machine)
    with twin, EspecP300(twin.address, clock=InstantClock()) as chamber:
        chamber.go_to(30.0)
        twin.stop()
        with pytest.raises(
            LinkError, match=r"ESPEC P300 at tcp://.*could not send 'TEMP\?'.*check that the instrument"
        ):
            chamber.read()
        twin.start()
        machine.air = 29.5
        assert chamber.read().temperature_c == 29.5


def test_a_driver_that_is_not_open_is_the_callers_fault(twin: SimulatedEspecP300) -> None:
    chamber = EspecP300(twin.address, clock=InstantClock())
    with pytest.raises(UsageError, match=r"call open\(\) first"):
        chamber.read()
    chamber.close()
    chamber.close()
