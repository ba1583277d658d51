"""The F4 driver against its simulated twin, over a real serial line."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from benchctl_instruments.chambers.watlow_f4 import WatlowF4
from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Chamber, Identity
from benchctl_instruments.links.modbus import Retry
from benchctl_instruments.simulated.modbus_server import ModbusRtuServer, RegisterTable, word
from benchctl_instruments.simulated.serial_line import SerialLine
from benchctl_instruments.simulated.watlow_f4 import SimulatedWatlowF4
from tests.instruments.chamber_machine import FakeChamber, InstantClock
from tests.instruments.modbus_device import Misbehaving

QUICK = Retry(attempts=2, wait_s=0.01)


@pytest.fixture
def machine() -> FakeChamber:
    return FakeChamber()


@pytest.fixture
def twin(machine: FakeChamber) -> Iterator[SimulatedWatlowF4]:
    with SimulatedWatlowF4(machine) as twin:
        yield twin


def driver_at(address: str, *, unit_id: int = 1, on_event: int | None = 1) -> WatlowF4:
    return WatlowF4(
        address,
        clock=InstantClock(),
        unit_id=unit_id,
        on_event=on_event,
        pause_s=0.0,
        timeout_s=0.2,
        retry=QUICK,
    )


@pytest.fixture
def chamber(twin: SimulatedWatlowF4) -> Iterator[WatlowF4]:
    with driver_at(twin.address) as chamber:
        yield chamber


def test_it_is_a_chamber(chamber: WatlowF4) -> None:
    as_chamber: Chamber = chamber
    assert as_chamber.identify() == Identity(manufacturer="Watlow", model="F4S")


def test_air_set_point_and_power_are_read_with_their_signs(chamber: WatlowF4, machine: FakeChamber) -> None:
    machine.air, machine.setpoint, machine.power = -40.04, -55.5, -37.5
    reading = chamber.read()
    assert (reading.temperature_c, reading.setpoint_c, reading.power_percent) == (-40.0, -55.5, -37.5)
    machine.air, machine.power = 84.96, 12.34
    reading = chamber.read()
    assert (reading.temperature_c, reading.power_percent, reading.alarms) == (85.0, 12.34, ())


def test_it_does_not_matter_that_the_line_goes_over_tcp(machine: FakeChamber) -> None:
    with SimulatedWatlowF4(machine, over_tcp=True) as twin, driver_at(twin.address) as chamber:
        assert twin.address.startswith("socket://")
        chamber.go_to(-40.5)
        chamber.start()
        assert (machine.setpoint, machine.on, chamber.read().setpoint_c) == (-40.5, True, -40.5)


@pytest.mark.parametrize(("decimals", "arrives_c"), [(0, -12.0), (1, -12.3), (2, -12.35)])
def test_a_set_point_goes_to_the_nearest_step_of_the_controllers_decimals(
    machine: FakeChamber, decimals: int, arrives_c: float
) -> None:
    with SimulatedWatlowF4(machine, decimals=decimals) as twin, driver_at(twin.address) as chamber:
        chamber.go_to(-12.345678)
        assert machine.setpoint == arrives_c
        assert chamber.read().setpoint_c == arrives_c
        assert chamber.read().temperature_c == 23.0


def test_a_set_point_beyond_the_controllers_limits_is_refused_before_anything_is_written(
    chamber: WatlowF4, machine: FakeChamber
) -> None:
    chamber.set_limits(-10.0, 60.0)
    for wrong in (60.1, -10.1, float("nan")):
        with pytest.raises(
            UsageError, match=rf"set point {wrong:g} °C lies outside the controller's limits -10 to 60 °C"
        ):
            chamber.go_to(wrong)
    assert machine.setpoint == 20.0
    chamber.go_to(60.0)
    assert machine.setpoint == 60.0


def test_a_set_point_may_lie_on_a_limit_between_two_steps_of_the_register(
    chamber: WatlowF4, machine: FakeChamber
) -> None:
    chamber.set_limits(-10.04, 60.04)
    for setpoint_c, arrives_c in ((60.04, 60.0), (-10.04, -10.0)):
        chamber.go_to(setpoint_c)
        assert machine.setpoint == arrives_c


@pytest.mark.parametrize(("low_c", "high_c"), [(-60.0, -50.0), (100.5, 120.0), (-70.0, 180.0)])
def test_new_limits_arrive_whatever_the_present_ones_are(chamber: WatlowF4, low_c: float, high_c: float) -> None:
    for low, high in ((0.0, 50.0), (low_c, high_c), (0.0, 50.0)):
        chamber.set_limits(low, high)
        with pytest.raises(UsageError, match=f"limits {low:g} to {high:g} °C"):
            chamber.go_to(300.0)


def test_limits_the_wrong_way_round_or_beyond_the_register_are_refused(chamber: WatlowF4) -> None:
    with pytest.raises(UsageError, match="set point limits 50 to 20 °C; give the lower one first"):
        chamber.set_limits(50.0, 20.0)
    with pytest.raises(UsageError, match="set point high limit cannot be set to 4000 °C"):
        chamber.set_limits(0.0, 4000.0)


def test_conditioning_is_switched_by_the_declared_event_and_confirmed(chamber: WatlowF4, machine: FakeChamber) -> None:
    seen = []
    for switch in (chamber.start, chamber.start, chamber.stop, chamber.stop):
        switch()
        seen.append(machine.running())
    assert seen == [True, True, False, False]
    assert machine.setpoint == 20.0


def test_conditioning_may_be_wired_to_another_event(machine: FakeChamber) -> None:
    with SimulatedWatlowF4(machine, on_event=5) as twin, driver_at(twin.address, on_event=5) as chamber:
        chamber.start()
        assert machine.on


def test_a_chamber_without_such_an_event_is_left_as_it_is(twin: SimulatedWatlowF4, machine: FakeChamber) -> None:
    with driver_at(twin.address, on_event=None) as chamber:
        chamber.start()
        chamber.stop()
    assert machine.switched == 0
    with pytest.raises(UsageError, match="on_event = 9: expected an event of a Watlow F4, 1 to 8"):
        driver_at(twin.address, on_event=9)


def test_a_controller_that_does_not_do_what_it_acknowledged_is_found_out(
    chamber: WatlowF4, machine: FakeChamber, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "set_setpoint", lambda setpoint_c: None)
    with pytest.raises(InstrumentError, match=r"set point 1 \(register 300\) should be -5 °C and still reads 20 °C"):
        chamber.go_to(-5.0)


def test_a_running_profile_is_not_fought_with(chamber: WatlowF4, twin: SimulatedWatlowF4, machine: FakeChamber) -> None:
    twin.mode = 2
    with pytest.raises(InstrumentError, match="runs a profile and would not keep our set point"):
        chamber.start()
    assert not machine.on


def test_the_pause_that_the_controller_wants_passes_in_bench_time(twin: SimulatedWatlowF4) -> None:
    clock = InstantClock()
    with WatlowF4(twin.address, clock=clock) as chamber:
        opened_s = clock.now()
        chamber.read()
    assert clock.now() - opened_s == pytest.approx(3 * 0.03)  # neighbours come together: 100-103, 106-107, 300


def test_alarms_are_latched_until_they_are_cleared(chamber: WatlowF4, machine: FakeChamber) -> None:
    machine.air = 187.0
    assert chamber.read().alarms == ("alarm 1 high",)
    machine.air = -90.0
    assert chamber.read().alarms == ("alarm 1 low", "alarm 2 low")
    machine.air = 23.0
    assert chamber.read().alarms == ("alarm 1 low", "alarm 2 low")


def test_a_broken_sensor_is_an_error_and_not_a_temperature(chamber: WatlowF4, twin: SimulatedWatlowF4) -> None:
    twin.input_error = 3
    with pytest.raises(
        InstrumentError, match=r"no valid temperature, input error 3 \(over range\); check the chamber's"
    ):
        chamber.read()


def test_the_wrong_unit_number_is_silence_that_names_it(twin: SimulatedWatlowF4) -> None:
    with pytest.raises(
        LinkError, match=r"Watlow F4 at .*, unit 2: reading register 606 came to nothing, tried 2 times: no answer"
    ):
        driver_at(twin.address, unit_id=2).open()


@pytest.mark.parametrize(
    ("decimals", "unit", "said"),
    [
        (17, 1, "register 606 reads 17, expected 0 to 3 decimals; check that it is a Watlow F4"),
        (1, 0, "register 901 reads 0, expected 1 .°C.; set the controller to degrees Celsius"),
        (1, 1, "reading registers 602 to 603 was refused with exception 2"),
    ],
)
def test_a_controller_that_is_not_what_it_should_be_is_refused_and_the_port_let_go(
    decimals: int, unit: int, said: str
) -> None:
    registers = RegisterTable([word(606, lambda: decimals), word(901, lambda: unit)])
    with ModbusRtuServer(registers, unit_id=1) as server:
        for _ in range(2):
            with pytest.raises(InstrumentError, match=said):
                driver_at(server.address).open()


def test_limits_that_make_no_sense_are_found_when_it_is_opened() -> None:
    registers = RegisterTable([word(606, lambda: 1), word(901, lambda: 1), word(602, lambda: 0), word(603, lambda: 0)])
    with (
        ModbusRtuServer(registers, unit_id=1) as server,
        pytest.raises(InstrumentError, match="limits read 0 and 0 °C"),
    ):
        driver_at(server.address).open()


def test_noise_before_every_other_answer_does_no_harm() -> None:
    device = Misbehaving(lambda count, answer: b"\x01\x03" + answer if count % 2 == 0 else answer)
    its_own_number = "register 606 reads 606"
    with SerialLine(device.connect) as line, pytest.raises(InstrumentError, match=its_own_number):
        driver_at(line.address).open()
    assert [request.address for request in device.asked] == [606, 606]
