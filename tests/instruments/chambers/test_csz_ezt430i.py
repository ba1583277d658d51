"""The EZT-430i driver against its simulated twin, over a real serial line, byte for byte."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from benchctl_instruments.chambers.csz_ezt430i import CszEzt430i
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.simulated.csz_ezt430i import SimulatedCszEzt430i
from tests.instruments.chamber_machine import FakeChamber, InstantClock
from tests.instruments.wire_transcript import Transcript


class BusyFor(InstantClock):
    """A clock in whose time the controller becomes free."""

    def __init__(self, twin: SimulatedCszEzt430i, seconds: float) -> None:
        super().__init__()
        self._twin = twin
        self._seconds = seconds

    def sleep(self, seconds: float) -> None:
        super().sleep(seconds)
        if self.slept_s >= self._seconds:
            self._twin.busy = 0


@pytest.fixture
def machine() -> FakeChamber:
    return FakeChamber()


@pytest.fixture
def twin(machine: FakeChamber) -> Iterator[SimulatedCszEzt430i]:
    with SimulatedCszEzt430i(machine) as twin:
        yield twin


@pytest.fixture
def chamber(twin: SimulatedCszEzt430i) -> Iterator[CszEzt430i]:
    with CszEzt430i(twin.address, clock=InstantClock(), timeout_s=0.5) as chamber:
        yield chamber


def test_two_runs_make_a_reading_and_single_writes_a_set_point(machine: FakeChamber) -> None:
    machine.air, machine.setpoint, machine.power = 78.1, 49.9, 12.5
    heard = Transcript()
    with (
        SimulatedCszEzt430i(machine) as twin,
        CszEzt430i(twin.address, clock=InstantClock(), wire_log=heard.log) as chamber,
    ):
        heard.lines.clear()
        reading = chamber.read()
        chamber.go_to(-12.5)
    assert heard.lines == [
        "> 01 03 00 00 00 06 C5 C8",
        "< 01 03 0C 00 00 00 00 00 00 00 00 00 00 00 00 93 70",
        "> 01 03 00 23 00 05 74 03",
        "< 01 03 0A 03 0D 01 F3 04 E2 00 00 00 00 77 78",
        "> 01 03 00 00 00 06 C5 C8",
        "< 01 03 0C 00 00 00 00 00 00 00 00 00 00 00 00 93 70",
        "> 01 06 00 24 FF 83 C9 90",
        "< 01 06 00 24 FF 83 C9 90",
        "> 01 03 00 23 00 05 74 03",
        "< 01 03 0A 03 0D FF 83 04 E2 00 00 00 00 88 77",
    ]
    assert (reading.temperature_c, reading.setpoint_c, reading.power_percent) == (78.1, 49.9, 12.5)


def test_conditioning_is_one_bit_of_the_system_events(
    chamber: CszEzt430i, twin: SimulatedCszEzt430i, machine: FakeChamber
) -> None:
    twin.events = 0b110000
    chamber.start()
    assert (twin.events, machine.on) == (0b110001, True)
    chamber.stop()
    assert (twin.events, machine.on) == (0b110000, False)
    assert twin.reserved_writes == 0


def test_another_event_and_decimal_point_are_settings(machine: FakeChamber) -> None:
    changes = {"switch": {"bit": 3}, "decimals": 2}
    with (
        SimulatedCszEzt430i(machine, on_event=4, decimals=2) as twin,
        CszEzt430i(twin.address, clock=InstantClock(), changes=changes) as chamber,
    ):
        chamber.go_to(-12.345)
        chamber.start()
        assert (machine.on, twin.events, machine.setpoint) == (True, 0b1000, -12.34)


def test_a_busy_controller_is_waited_for(twin: SimulatedCszEzt430i, machine: FakeChamber) -> None:
    clock = BusyFor(twin, 3.0)
    with CszEzt430i(twin.address, clock=clock, pause_s=0.0) as chamber:
        twin.busy = 1
        chamber.go_to(-5.0)
        assert machine.setpoint == -5.0
    assert clock.slept_s == pytest.approx(3.0)


def test_a_controller_that_stays_busy_is_an_error_and_nothing_is_written(
    chamber: CszEzt430i, twin: SimulatedCszEzt430i, machine: FakeChamber
) -> None:
    twin.busy = 1
    for action in (lambda: chamber.go_to(-5.0), chamber.start, chamber.read):
        with pytest.raises(InstrumentError, match=r"busy or offline \(register 0 reads 1\) for more than 10 s"):
            action()
    assert (machine.setpoint, machine.switched) == (20.0, 0)


def test_a_controller_that_means_ready_by_its_busy_register_is_a_setting_which_the_refusal_names(
    twin: SimulatedCszEzt430i, machine: FakeChamber
) -> None:
    twin.busy = 1
    with pytest.raises(InstrumentError, match=r"one public client takes it for ready; .* changes = (\{ busy = .* \})$"):
        CszEzt430i(twin.address, clock=InstantClock()).open()
    with CszEzt430i(twin.address, clock=InstantClock(), changes={"busy": {"free": [0, 1]}}) as chamber:
        assert chamber.read().temperature_c == 23.0


def test_a_stop_that_a_busy_controller_does_not_carry_out_is_found_out(
    chamber: CszEzt430i, twin: SimulatedCszEzt430i, machine: FakeChamber
) -> None:
    chamber.start()
    twin.busy = 1
    with pytest.raises(InstrumentError, match=r"conditioning, bit 0 \(register 12\) should be 0 and still reads 1"):
        chamber.stop()
    assert machine.on


@pytest.mark.parametrize(
    ("code", "says"), [(39, "loop 1 has a sensor break"), (30, "has a cold junction failure"), (77, "shows code 77")]
)
def test_a_loop_error_that_touches_the_sensor_is_no_temperature(
    chamber: CszEzt430i, twin: SimulatedCszEzt430i, code: int, says: str
) -> None:
    twin.loop_error = code
    with pytest.raises(InstrumentError, match=f"no valid temperature, .*{says}"):
        chamber.read()


def test_an_error_in_an_earlier_request_of_somebody_is_no_sensor_break(
    chamber: CszEzt430i, twin: SimulatedCszEzt430i
) -> None:
    twin.loop_error = 15
    assert chamber.read().alarms == ()
    twin.loop_error = 4
    assert chamber.read().alarms == ("loop 1 has illegal set-up values",)


def test_a_latched_alarm_is_told_with_what_clears_it_and_never_cleared(
    chamber: CszEzt430i, machine: FakeChamber
) -> None:
    how = "(latched; once its cause is gone, write 1 to register 1)"
    machine.air = 195.0
    assert chamber.read().alarms == (f"input alarm shows code 1 {how}",)
    machine.air = 23.0
    assert chamber.read().alarms == (f"input alarm shows code 1 {how}",)
    with pytest.raises(InstrumentError, match=r"not switched on while it has input alarm .* write 1 to register 1"):
        chamber.start()
    assert not machine.on
    chamber.stop()


@pytest.mark.parametrize(
    ("name", "says"), [("manual_override", "manual override: of loop 1"), ("program", "a program")]
)
def test_what_would_not_keep_our_set_point_is_refused(
    chamber: CszEzt430i, twin: SimulatedCszEzt430i, machine: FakeChamber, name: str, says: str
) -> None:
    setattr(twin, name, 1)
    with pytest.raises(InstrumentError, match=f"it would not keep our set point, {says}"):
        chamber.start()
    assert not machine.on
