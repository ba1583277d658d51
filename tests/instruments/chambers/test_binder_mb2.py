"""The MB2 driver against its simulated twin, over a real serial line, byte for byte."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from benchctl_instruments.chambers.binder_mb2 import BinderMb2
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.simulated.binder_mb2 import IDLE, SimulatedBinderMb2
from tests.instruments.chamber_machine import FakeChamber, InstantClock
from tests.instruments.wire_transcript import Transcript

ANTICONDENSATION = 1 << 6


@pytest.fixture
def machine() -> FakeChamber:
    return FakeChamber()


@pytest.fixture
def twin(machine: FakeChamber) -> Iterator[SimulatedBinderMb2]:
    with SimulatedBinderMb2(machine) as twin:
        yield twin


@pytest.fixture
def chamber(twin: SimulatedBinderMb2) -> Iterator[BinderMb2]:
    with BinderMb2(twin.address, clock=InstantClock(), timeout_s=0.5) as chamber:
        yield chamber


def test_singles_go_low_word_first_and_the_idle_bit_is_written_elsewhere_than_it_is_read(machine: FakeChamber) -> None:
    machine.air = 78.1
    heard = Transcript()
    with (
        SimulatedBinderMb2(machine) as twin,
        BinderMb2(twin.address, clock=InstantClock(), wire_log=heard.log) as chamber,
    ):
        heard.lines.clear()
        assert chamber.read().temperature_c == pytest.approx(78.1)
        chamber.go_to(-12.5)
        chamber.start()
    assert heard.lines == [
        "> 01 03 10 B2 00 02 60 EC",
        "< 01 03 04 00 00 41 A0 CA 1B",
        "> 01 03 10 D2 00 02 60 F2",
        "< 01 03 04 33 33 42 9C 35 B1",
        "> 01 10 11 4C 00 02 04 00 00 C1 48 66 3C",
        "< 01 10 11 4C 00 02 85 23",
        "> 01 03 12 92 00 01 20 9F",
        "< 01 03 02 00 02 39 85",
        "> 01 03 10 A6 00 04 A0 EA",
        "< 01 03 08 00 00 00 00 00 00 00 00 95 D7",
        "> 01 03 12 92 00 01 20 9F",
        "< 01 03 02 00 02 39 85",
        "> 01 06 11 58 00 00 0D 25",
        "< 01 06 11 58 00 00 0D 25",
        "> 01 03 12 92 00 01 20 9F",
        "< 01 03 02 00 00 B8 44",
        "> 01 03 10 B2 00 02 60 EC",
        "< 01 03 04 00 00 C1 48 AB 95",
    ]


def test_the_set_point_of_an_idle_chamber_is_confirmed_once_it_conditions(
    chamber: BinderMb2, machine: FakeChamber
) -> None:
    chamber.go_to(-30.5)
    assert chamber.read().setpoint_c == 20.0  # that of idling, which it obeys
    chamber.start()
    assert (machine.on, machine.setpoint, chamber.read().setpoint_c) == (True, -30.5, -30.5)
    chamber.go_to(60.0)
    assert chamber.read().setpoint_c == 60.0
    chamber.stop()
    assert not machine.on


def test_a_set_point_that_is_not_taken_over_is_found_out(
    chamber: BinderMb2, machine: FakeChamber, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "set_setpoint", lambda setpoint_c: None)
    chamber.go_to(50.0)
    with pytest.raises(
        InstrumentError, match=r"set point taken over \(register 4274\) should be 50 °C and still reads 20 °C"
    ):
        chamber.start()


def test_the_other_operation_contacts_stay_as_they_are(chamber: BinderMb2, twin: SimulatedBinderMb2) -> None:
    twin.contacts = IDLE | ANTICONDENSATION
    chamber.start()
    assert twin.contacts == ANTICONDENSATION
    chamber.stop()
    assert twin.contacts == IDLE | ANTICONDENSATION


def test_a_running_program_is_told_once_and_not_fought_with(chamber: BinderMb2, twin: SimulatedBinderMb2) -> None:
    twin.program_left_s = 100_000  # in two registers
    with pytest.raises(InstrumentError, match="it would not keep our set point, a program runs; end that on its panel"):
        chamber.start()


@pytest.mark.parametrize("write_denied", [5, 8])
def test_a_program_denies_even_stopping_and_the_exception_is_told(machine: FakeChamber, write_denied: int) -> None:
    with (
        SimulatedBinderMb2(machine, write_denied=write_denied) as twin,
        BinderMb2(twin.address, clock=InstantClock()) as chamber,
    ):
        twin.program_left_s = 60
        with pytest.raises(InstrumentError, match=rf"to register 4440 was refused with exception {write_denied}"):
            chamber.stop()


def test_a_controller_that_is_not_ready_says_so(chamber: BinderMb2, twin: SimulatedBinderMb2) -> None:
    twin.ready = False
    with pytest.raises(InstrumentError, match="was refused with exception 4"):
        chamber.read()


@pytest.mark.parametrize(
    ("air_c", "says"), [(math.nan, r"reads no number \(NaN\)"), (999.0, "reads 999 °C, expected -120 to 250")]
)
def test_what_no_chamber_can_have_is_no_temperature(
    chamber: BinderMb2, machine: FakeChamber, air_c: float, says: str
) -> None:
    machine.air = air_c
    with pytest.raises(InstrumentError, match=rf"no valid temperature, air temperature \(register 4306\) {says}"):
        chamber.read()


def test_power_without_a_register_is_no_number(chamber: BinderMb2) -> None:
    assert math.isnan(chamber.read().power_percent)


def test_the_other_word_order_is_found_when_it_is_opened_and_named(machine: FakeChamber) -> None:
    with (
        SimulatedBinderMb2(machine, word_order="high_first") as twin,
        pytest.raises(InstrumentError, match=r"makes no sense; .* try word_order = 'high_first'"),
    ):
        BinderMb2(twin.address, clock=InstantClock()).open()
    with (
        SimulatedBinderMb2(machine, word_order="high_first") as twin,
        BinderMb2(twin.address, clock=InstantClock(), word_order="high_first") as chamber,
    ):
        assert chamber.read().temperature_c == 23.0
