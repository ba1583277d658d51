"""The MB1 driver against its simulated twin, byte for byte, and against the dumped memory of a real MK 53."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from benchctl_instruments.chambers.binder_mb1 import BinderMb1
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.simulated.binder_mb1 import BASIC, IDLE, PROGRAM, SETPOINTS, SimulatedBinderMb1
from benchctl_instruments.simulated.modbus_server import ModbusRtuServer, RegisterTable, laid_out
from tests.instruments.chamber_machine import FakeChamber, InstantClock
from tests.instruments.wire_transcript import Transcript

# What ovenctl's tool nmbdump read from an MK 53: the words of nmbdumps/*.hex at the registers that the driver reads.
OVENCTL = {
    "open": {0x11A9: (0xA5F1, 0x41E1), 0x1077: (0, 0x420C), 0x123D: (0,), 0x1A22: (0,)},
    "active": {0x11A9: (0x1C12, 0x4233), 0x1077: (0, 0x4234), 0x123D: (0,), 0x1A22: (0x0800,)},
    "limit": {0x11A9: (0x293A, 0x4235), 0x1077: (0, 0x4234), 0x123D: (1,), 0x1A22: (0x0800,)},
}
NO_SENSOR = (0x50C0, 0x4843)  # of an input that is not there, at 1103h for one


@pytest.fixture
def machine() -> FakeChamber:
    return FakeChamber()


@pytest.fixture
def twin(machine: FakeChamber) -> Iterator[SimulatedBinderMb1]:
    with SimulatedBinderMb1(machine) as twin:
        yield twin


@pytest.fixture
def chamber(twin: SimulatedBinderMb1) -> Iterator[BinderMb1]:
    with BinderMb1(twin.address, clock=InstantClock(), timeout_s=0.5) as chamber:
        yield chamber


def dumped(words: dict[int, tuple[int, ...]]) -> ModbusRtuServer:
    return ModbusRtuServer(RegisterTable([], memory=laid_out(words)), unit_id=1)


@pytest.mark.parametrize(
    ("dump", "air_c", "setpoint_c", "alarms"),
    [
        ("open", 28.206, 35.0, ()),
        ("active", 44.777, 45.0, ()),
        ("limit", 45.290, 45.0, ("alarm is shown on its panel, which resets it",)),
    ],
)
def test_what_a_real_mk53_had_in_its_memory_is_read(
    dump: str, air_c: float, setpoint_c: float, alarms: tuple[str, ...]
) -> None:
    with (
        dumped(OVENCTL[dump]) as real,
        BinderMb1(real.address, clock=InstantClock()) as chamber,
    ):
        reading = chamber.read()
    assert reading.temperature_c == pytest.approx(air_c, abs=1e-3)
    assert (reading.setpoint_c, reading.alarms) == (setpoint_c, alarms)
    assert math.isnan(reading.power_percent)


def test_the_number_of_an_input_without_a_sensor_is_no_temperature() -> None:
    with (
        dumped({**OVENCTL["active"], 0x11A9: NO_SENSOR}) as real,
        BinderMb1(real.address, clock=InstantClock()) as chamber,
        pytest.raises(InstrumentError, match=r"reads 200003 °C, expected -120 to 250"),
    ):
        chamber.read()


def test_both_set_points_are_written_and_manual_mode_is_switched_on(machine: FakeChamber) -> None:
    heard = Transcript()
    with (
        SimulatedBinderMb1(machine) as twin,
        BinderMb1(twin.address, clock=InstantClock(), wire_log=heard.log) as chamber,
    ):
        heard.lines.clear()
        chamber.go_to(-12.5)
        chamber.start()
    sent = [line for line in heard.lines if line.startswith("> 01 06") or line.startswith("> 01 10")]
    assert sent == [
        "> 01 10 15 81 00 02 04 00 00 C1 48 99 35",
        "> 01 10 15 6F 00 02 04 00 00 C1 48 16 F1",
        "> 01 06 1A 22 08 00 29 18",
    ]


@pytest.mark.parametrize("manual_at", SETPOINTS)
def test_whichever_set_point_is_that_of_manual_mode_the_chamber_follows(machine: FakeChamber, manual_at: int) -> None:
    with (
        SimulatedBinderMb1(machine, manual_at=manual_at) as twin,
        BinderMb1(twin.address, clock=InstantClock()) as chamber,
    ):
        chamber.go_to(-30.5)
        assert (machine.setpoint, chamber.read().setpoint_c) == (20.0, -30.5)
        chamber.start()
        assert (machine.on, machine.setpoint, chamber.read().setpoint_c) == (True, -30.5, -30.5)
        chamber.go_to(60.0)
        assert (machine.setpoint, chamber.read().setpoint_c) == (60.0, 60.0)
        chamber.stop()
        assert (machine.on, twin.mode) == (False, IDLE)


def test_a_chamber_that_shows_idle_as_basic_mode_counts_as_off(
    chamber: BinderMb1, twin: SimulatedBinderMb1, machine: FakeChamber, monkeypatch: pytest.MonkeyPatch
) -> None:
    chamber.start()
    set_mode = twin._set_mode
    monkeypatch.setattr(twin, "_set_mode", lambda mode: set_mode(mode or BASIC))
    chamber.stop()
    assert not machine.on


def test_a_running_program_is_told_once_and_not_fought_with(chamber: BinderMb1, twin: SimulatedBinderMb1) -> None:
    twin.mode = PROGRAM
    with pytest.raises(
        InstrumentError, match="it would not keep our set point, a program: runs; end that on its panel"
    ):
        chamber.start()


def test_a_set_point_that_is_not_taken_over_is_found_out(
    chamber: BinderMb1, machine: FakeChamber, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "set_setpoint", lambda setpoint_c: None)
    chamber.go_to(50.0)
    with pytest.raises(
        InstrumentError, match=r"set point taken over \(register 4215\) should be 50 °C and still reads 20 °C"
    ):
        chamber.start()


@pytest.mark.parametrize("write_denied", [5, 8])
def test_a_write_that_is_denied_names_the_exception(machine: FakeChamber, write_denied: int) -> None:
    with (
        SimulatedBinderMb1(machine, write_denied=write_denied) as twin,
        BinderMb1(twin.address, clock=InstantClock(), changes={"setpoint": {"address": 0x1077}}) as chamber,
        pytest.raises(
            InstrumentError,
            match=rf"to registers 4215 to 4216 was refused with exception {write_denied} \(.*write denied\)",
        ),
    ):
        chamber.go_to(50.0)
