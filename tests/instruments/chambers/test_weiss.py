"""The drivers of Weiss and Vötsch chambers against their simulated ones: SIMSERV over TCP, ASCII-2 over both lines."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator

import pytest

from benchctl_instruments.chambers.weiss_ascii2 import WeissAscii2
from benchctl_instruments.chambers.weiss_simserv import WeissSimserv
from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.interfaces import Chamber, Identity
from benchctl_instruments.links.lines import NoAnswerError
from benchctl_instruments.simulated.serial_line import line_conversation
from benchctl_instruments.simulated.tcp_server import TcpServer
from benchctl_instruments.simulated.weiss_ascii2 import SimulatedWeissAscii2
from benchctl_instruments.simulated.weiss_simserv import SimulatedWeissSimserv
from tests.instruments.chamber_machine import FakeChamber, InstantClock

SERIAL = pytest.param("ascii2 serial", marks=pytest.mark.skipif(sys.platform == "win32", reason="needs terminals"))


@pytest.fixture
def machine() -> FakeChamber:
    return FakeChamber()


@pytest.fixture
def simserv(machine: FakeChamber) -> Iterator[SimulatedWeissSimserv]:
    with SimulatedWeissSimserv(machine) as twin:
        yield twin


@pytest.fixture
def ascii2(machine: FakeChamber) -> Iterator[SimulatedWeissAscii2]:
    with SimulatedWeissAscii2(machine, over_tcp=True) as twin:
        yield twin


@pytest.fixture(params=["simserv", "ascii2 tcp", SERIAL])
def chamber(machine: FakeChamber, request: pytest.FixtureRequest) -> Iterator[Chamber]:
    if request.param == "simserv":
        with SimulatedWeissSimserv(machine) as twin, WeissSimserv(twin.address, clock=InstantClock()) as chamber:
            yield chamber
    else:
        over_tcp = request.param == "ascii2 tcp"
        with (
            SimulatedWeissAscii2(machine, over_tcp=over_tcp) as other,
            WeissAscii2(other.address, clock=InstantClock()) as chamber2,
        ):
            yield chamber2


def test_it_reads_sets_starts_and_stops(chamber: Chamber, machine: FakeChamber) -> None:
    machine.air = -40.04
    chamber.set_limits(-60.0, 85.0)
    reading = chamber.read()
    assert (reading.temperature_c, reading.setpoint_c, reading.alarms) == (-40.0, 20.0, ())
    assert math.isnan(reading.power_percent)
    chamber.go_to(-12.345678)
    assert (machine.setpoint, machine.on) == (-12.3, False)
    seen = []
    for switch in (chamber.start, chamber.start, chamber.stop, chamber.stop):
        switch()
        seen.append(machine.on)
    assert (seen, machine.switched, machine.setpoint) == ([True, True, False, False], 2, -12.3)
    chamber.start()
    chamber.go_to(85.0)
    assert (machine.on, chamber.read().setpoint_c) == (True, 85.0)


def test_a_set_point_beyond_the_limits_is_refused_before_anything_is_written(
    chamber: Chamber, machine: FakeChamber
) -> None:
    with pytest.raises(UsageError, match=r"set point 180\.1 °C lies outside the limits -75 to 180 °C"):
        chamber.go_to(180.1)  # its own range, before the bench has said anything
    chamber.set_limits(-10.0, 60.0)
    for wrong in (60.1, -10.1, math.nan, math.inf):
        with pytest.raises(UsageError, match=f"set point {wrong:g} °C lies outside the limits -10 to 60 °C"):
            chamber.go_to(wrong)
    assert machine.setpoint == 20.0


def test_limits_that_cannot_be_are_refused(chamber: Chamber) -> None:
    with pytest.raises(UsageError, match="set point limits 50 to 20 °C; give the lower one first"):
        chamber.set_limits(50.0, 20.0)
    with pytest.raises(UsageError, match="give the lower one first"):
        chamber.set_limits(math.nan, 20.0)
    with pytest.raises(InstrumentError, match="limits -80 to 60 °C exceed the controller's own, -75 to 180 °C"):
        chamber.set_limits(-80.0, 60.0)


# SIMSERV --------------------------------------------------------------------------------------------------------------


def test_simserv_says_type_and_serial_number(simserv: SimulatedWeissSimserv) -> None:
    with WeissSimserv(simserv.address, clock=InstantClock()) as chamber:
        expected = Identity(manufacturer="Weiss/Vötsch", model="LabEvent T/210/70/5", serial="SIMULATED")
        assert chamber.identify() == expected


def test_simserv_reports_active_alarms_and_leaves_warnings_and_information_out(
    simserv: SimulatedWeissSimserv,
) -> None:
    with WeissSimserv(simserv.address, clock=InstantClock()) as chamber:
        simserv.controller.active = {2, 3}
        assert chamber.read().alarms == ()
        simserv.controller.active = {1, 2, 3}
        assert chamber.read().alarms == ("Temperature beyond its limits",)


def test_a_running_program_is_refused_at_a_start_and_ended_by_a_stop(
    simserv: SimulatedWeissSimserv, machine: FakeChamber
) -> None:
    with WeissSimserv(simserv.address, clock=InstantClock()) as chamber:
        simserv.controller.run_program()
        with pytest.raises(InstrumentError, match="it runs a program and would not keep our set point"):
            chamber.start()
        chamber.stop()
        assert (simserv.controller.program, machine.on) == (0, False)


def test_the_gradient_is_written_at_the_start_and_only_if_it_is_asked_for(simserv: SimulatedWeissSimserv) -> None:
    def gradients() -> list[str]:
        return [simserv.controller.execute(f"{number}¶1¶1") for number in (11066, 11070)]

    with WeissSimserv(simserv.address, clock=InstantClock()) as plain:
        plain.start()
    assert gradients() == ["1¶0.0", "1¶0.0"]
    with WeissSimserv(simserv.address, clock=InstantClock(), ramp_c_per_min=2.5) as chamber:
        assert gradients() == ["1¶0.0", "1¶0.0"]
        chamber.start()
    assert gradients() == ["1¶2.5", "1¶2.5"]
    with pytest.raises(UsageError, match=r"ramp_c_per_min = 0; give °C/min, 0\.1 or more"):
        WeissSimserv(simserv.address, clock=InstantClock(), ramp_c_per_min=0)


def test_a_chamber_without_programs_is_started_and_a_refusal_is_told_in_words(machine: FakeChamber) -> None:
    twin = SimulatedWeissSimserv(machine)
    del twin.controller._commands[19210]
    with twin, WeissSimserv(twin.address, clock=InstantClock()) as chamber:
        chamber.start()
        assert machine.on
        del twin.controller._commands[11004]
        with pytest.raises(InstrumentError, match="'11004¶1¶1' was refused with '-5': it does not know the command"):
            chamber.read()


def test_a_serial_port_is_no_place_for_simserv() -> None:
    with pytest.raises(UsageError, match="expected tcp://HOST:PORT"):
        WeissSimserv("serial:///dev/ttyUSB0", clock=InstantClock())


# ASCII-2 --------------------------------------------------------------------------------------------------------------


def test_humidity_fan_and_other_channels_stay_as_they_are(ascii2: SimulatedWeissAscii2) -> None:
    ascii2.controller.execute("$01E 0020.0 0080.0 0090.0 0000.0 0000.0 0000.0 0000.0 00100001000100000000000000000000")
    with WeissAscii2(ascii2.address, clock=InstantClock()) as chamber:
        chamber.go_to(-40.0)
        chamber.start()
    state = str(ascii2.controller.execute("$01I"))
    assert state.startswith("-040.0 0023.0 0080.0 0066.7 0090.0 ")
    assert state.endswith(" 01100001000100000000000000000000")


def test_a_chamber_that_stops_by_itself_is_an_alarm(ascii2: SimulatedWeissAscii2) -> None:
    with WeissAscii2(ascii2.address, clock=InstantClock()) as chamber:
        chamber.start()
        assert chamber.read().alarms == ()
        ascii2.controller.stop_by_itself()
        assert chamber.read().alarms == (
            "conditioning is off although it was switched on: the chamber's panel shows why",
        )
        chamber.stop()
        assert chamber.read().alarms == ()


def test_a_chamber_at_another_address_is_not_found(ascii2: SimulatedWeissAscii2) -> None:
    chamber = WeissAscii2(ascii2.address, clock=InstantClock(), unit_id=7, timeout_s=0.1)
    with pytest.raises(NoAnswerError, match=r"address 7, at tcp://.*sent '\$07\?', no answer within 0.1 s"):
        chamber.open()
    with pytest.raises(UsageError, match="unit_id = 100; give the chamber's address, 0 to 99"):
        WeissAscii2(ascii2.address, clock=InstantClock(), unit_id=100)


def test_a_controller_that_acknowledges_a_write_and_ignores_it_is_found_out(ascii2: SimulatedWeissAscii2) -> None:
    def execute(line: str) -> str | None:
        return "0" if line.startswith("$01E") else ascii2.controller.execute(line)

    with (
        TcpServer(lambda: line_conversation(execute)) as server,
        WeissAscii2(server.address, clock=InstantClock()) as chamber,
        pytest.raises(InstrumentError, match="it acknowledged set point 30 °C, and still reads set point 20 °C"),
    ):
        chamber.go_to(30.0)
