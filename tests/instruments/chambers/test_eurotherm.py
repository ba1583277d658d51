"""The Eurotherm drivers against their simulated twins, over a real serial line, byte for byte."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from benchctl_instruments.chambers.eurotherm_2400 import Eurotherm2400
from benchctl_instruments.chambers.eurotherm_3500 import Eurotherm3500
from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Chamber, Identity
from benchctl_instruments.links.modbus import ModbusLink, Retry
from benchctl_instruments.simulated.eurotherm_2400 import SimulatedEurotherm2400
from benchctl_instruments.simulated.eurotherm_3500 import SimulatedEurotherm3500
from tests.instruments.chamber_machine import FakeChamber, InstantClock
from tests.instruments.wire_transcript import Transcript

ONCE = Retry(attempts=1, wait_s=0.0)


@pytest.fixture
def machine() -> FakeChamber:
    return FakeChamber()


@pytest.fixture
def twin(machine: FakeChamber) -> Iterator[SimulatedEurotherm2400]:
    with SimulatedEurotherm2400(machine) as twin:
        yield twin


@pytest.fixture
def chamber(twin: SimulatedEurotherm2400) -> Iterator[Eurotherm2400]:
    with Eurotherm2400(twin.address, clock=InstantClock(), timeout_s=0.5) as chamber:
        yield chamber


def test_it_is_a_chamber(chamber: Eurotherm2400) -> None:
    as_chamber: Chamber = chamber
    assert as_chamber.identify() == Identity(manufacturer="Eurotherm", model="2400")


def test_the_2400_is_asked_for_singles_at_twice_the_parameter_and_32768(machine: FakeChamber) -> None:
    machine.air, machine.setpoint, machine.power = 78.1, 49.9, 12.5
    heard = Transcript()
    with (
        SimulatedEurotherm2400(machine) as twin,
        Eurotherm2400(twin.address, clock=InstantClock(), wire_log=heard.log) as chamber,
    ):
        heard.lines.clear()
        reading = chamber.read()
        assert heard.lines == [
            "> 01 03 00 4B 00 01 F4 1C",
            "< 01 03 02 00 00 B8 44",
            "> 01 03 01 02 00 01 24 36",
            "< 01 03 02 00 00 B8 44",
            "> 01 03 80 02 00 06 4D C8",
            "< 01 03 0C 42 9C 33 33 42 47 99 9A 00 00 00 00 EE E3",
        ]
        heard.lines.clear()
        chamber.go_to(-12.5)
        assert heard.lines == [
            "> 01 03 80 04 00 02 AC 0A",
            "< 01 03 04 42 47 99 9A B4 65",
            "> 01 10 80 04 00 02 04 C1 48 00 00 2E 70",
            "< 01 10 80 04 00 02 29 C9",
            "> 01 03 80 04 00 02 AC 0A",
            "< 01 03 04 C1 48 00 00 47 D9",
        ]
    assert (reading.temperature_c, reading.setpoint_c) == pytest.approx((78.1, 49.9))


def test_the_3500_is_asked_for_its_own_registers_and_told_with_function_16(machine: FakeChamber) -> None:
    machine.air, machine.setpoint, machine.power, machine.on = 78.1, 49.9, 12.5, True
    heard = Transcript()
    with (
        SimulatedEurotherm3500(machine) as twin,
        Eurotherm3500(twin.address, clock=InstantClock(), wire_log=heard.log) as chamber,
    ):
        heard.lines.clear()
        reading = chamber.read()
        chamber.go_to(-12.5)
    assert heard.lines == [
        "> 01 03 00 02 00 01 25 CA",
        "< 01 03 02 01 F3 F9 91",
        "> 01 03 00 55 00 01 94 1A",
        "< 01 03 02 00 7D 78 65",
        "> 01 03 01 21 00 01 D5 FC",
        "< 01 03 02 03 0D 79 71",
        "> 01 03 27 E5 00 01 9F 49",
        "< 01 03 02 00 00 B8 44",
        "> 01 03 00 18 00 01 04 0D",
        "< 01 03 02 01 F3 F9 91",
        "> 01 10 00 18 00 01 02 FF 83 A5 D9",
        "< 01 10 00 18 00 01 81 CE",
        "> 01 03 00 18 00 01 04 0D",
        "< 01 03 02 FF 83 B8 15",
        "> 01 03 01 11 00 01 D5 F3",
        "< 01 03 02 00 00 B8 44",
        "> 01 03 00 02 00 01 25 CA",
        "< 01 03 02 FF 83 B8 15",
    ]
    assert (reading.temperature_c, reading.setpoint_c, reading.power_percent) == (78.1, 49.9, 12.5)


def test_the_3500s_alarm_summary_is_told(machine: FakeChamber) -> None:
    with (
        SimulatedEurotherm3500(machine) as twin,
        Eurotherm3500(twin.address, clock=InstantClock()) as chamber,
    ):
        assert chamber.read().alarms == ()
        twin.alarms = 4
        assert chamber.read().alarms == ("alarm summary says that an alarm is active",)


@pytest.mark.parametrize(("decimals", "says"), [(1, r"reads 1372 °C, expected -200 to 850"), (2, "reads 32767 .over")])
def test_a_3500_without_a_sensor_has_no_temperature(machine: FakeChamber, decimals: int, says: str) -> None:
    with (
        SimulatedEurotherm3500(machine, decimals=decimals) as twin,
        Eurotherm3500(twin.address, clock=InstantClock(), changes={"decimals": decimals}) as chamber,
    ):
        twin.sensor_broken = True
        with pytest.raises(InstrumentError, match=rf"no valid temperature, air temperature \(register 289\) {says}"):
            chamber.read()


def test_a_3500_that_obeys_its_second_set_point_is_not_started(machine: FakeChamber) -> None:
    with SimulatedEurotherm3500(machine) as twin:
        panel = ModbusLink(twin.address)
        panel.open()
        panel.write(25, [800])
        panel.write(15, [1])
        panel.close()
        with Eurotherm3500(twin.address, clock=InstantClock()) as chamber:
            chamber.go_to(-12.5)
            with pytest.raises(
                InstrumentError, match=r"taken over \(register 2\) should be -12.5 °C and still reads 80"
            ):
                chamber.start()


@pytest.mark.parametrize(
    ("twin_of", "driver"), [(SimulatedEurotherm2400, Eurotherm2400), (SimulatedEurotherm3500, Eurotherm3500)]
)
def test_off_is_manual_mode_without_output_for_manual_mode_alone_freezes_it(
    machine: FakeChamber,
    twin_of: type[SimulatedEurotherm2400 | SimulatedEurotherm3500],
    driver: type[Eurotherm2400 | Eurotherm3500],
) -> None:
    with twin_of(machine) as twin, driver(twin.address, clock=InstantClock()) as chamber:
        chamber.start()
        machine.power = 62.5
        assert chamber.read().power_percent == 62.5
        chamber.stop()
        assert not machine.on
        assert chamber.read().power_percent == 0.0
        chamber.start()
        assert machine.on


def test_the_same_set_point_is_not_written_into_the_eeprom_again(
    chamber: Eurotherm2400, twin: SimulatedEurotherm2400, machine: FakeChamber
) -> None:
    for setpoint_c in (-12.3, -12.3, 40.0, 40.0):
        chamber.go_to(setpoint_c)
    assert twin.eeprom_writes == 2
    assert machine.setpoint == 40.0


def test_a_broken_sensor_is_an_error_and_not_a_temperature_and_the_chamber_can_still_be_stopped(
    chamber: Eurotherm2400, twin: SimulatedEurotherm2400, machine: FakeChamber
) -> None:
    chamber.start()
    twin.sensor_broken = True
    with pytest.raises(
        InstrumentError,
        match=r"no valid temperature, sensor break is reported; status: sensor broken; check the chamber's sensor",
    ):
        chamber.read()
    chamber.close()
    chamber.open()
    chamber.stop()
    assert not machine.on


def test_alarm_bits_are_told_in_words(chamber: Eurotherm2400, twin: SimulatedEurotherm2400) -> None:
    twin.alarms = 0b0101
    assert chamber.read().alarms == ("status: alarm 1", "status: alarm 3")


@pytest.mark.parametrize(("status", "says"), [(2, "the program runs"), (4, "is held"), (64, "shows code 64")])
def test_a_running_program_is_not_fought_with(
    chamber: Eurotherm2400, twin: SimulatedEurotherm2400, machine: FakeChamber, status: int, says: str
) -> None:
    twin.program = status
    with pytest.raises(InstrumentError, match=f"it would not keep our set point, .*{says}; end that on its panel"):
        chamber.start()
    assert not machine.on


def test_a_set_point_beyond_the_limits_kept_here_is_refused_before_anything_is_written(
    chamber: Eurotherm2400, twin: SimulatedEurotherm2400
) -> None:
    chamber.set_limits(-55.0, 125.0)
    for wrong in (125.1, -55.1, float("nan")):
        with pytest.raises(UsageError, match="lies outside the controller's limits -55 to 125 °C"):
            chamber.go_to(wrong)
    assert twin.eeprom_writes == 0
    with pytest.raises(UsageError, match="give the lower one first"):
        chamber.set_limits(20.0, 20.0)


def test_a_set_point_that_the_controller_itself_refuses_is_told(chamber: Eurotherm2400) -> None:
    chamber.set_limits(-55.0, 1200.0)
    with pytest.raises(InstrumentError, match=r"registers 32772 to 32773 was refused with exception 3"):
        chamber.go_to(1000.0)


@pytest.mark.parametrize(("decimals", "arrives_c"), [(0, -12.0), (1, -12.3), (2, -12.35)])
def test_the_3500s_decimal_point_is_a_setting(machine: FakeChamber, decimals: int, arrives_c: float) -> None:
    with (
        SimulatedEurotherm3500(machine, decimals=decimals) as twin,
        Eurotherm3500(twin.address, clock=InstantClock(), changes={"decimals": decimals}) as chamber,
    ):
        chamber.go_to(-12.345678)
        assert machine.setpoint == arrives_c
        assert chamber.read().temperature_c == 23.0


def test_with_two_decimals_the_3500_reaches_no_further_than_its_register(machine: FakeChamber) -> None:
    with (
        SimulatedEurotherm3500(machine, decimals=2) as twin,
        Eurotherm3500(twin.address, clock=InstantClock(), changes={"decimals": 2}) as chamber,
    ):
        chamber.go_to(320.0)
        with pytest.raises(UsageError, match=r"limit cannot be set to 400 °C: its register \(signed\)"):
            chamber.set_limits(0.0, 400.0)


def test_silence_is_a_link_error_that_names_the_controller(twin: SimulatedEurotherm2400) -> None:
    chamber = Eurotherm2400(twin.address, clock=InstantClock(), unit_id=3, timeout_s=0.05, retry=ONCE)
    with pytest.raises(
        LinkError, match=r"Eurotherm 2400 at .*, unit 3: reading register 75 came to nothing, tried once: no"
    ):
        chamber.open()


def test_a_serial_address_without_a_speed_takes_the_profiles() -> None:
    chamber = Eurotherm2400("serial:///dev/not_there", clock=InstantClock(), retry=ONCE)
    with pytest.raises(LinkError, match=r"serial:///dev/not_there\?baud=9600"):
        chamber.open()
    other = Eurotherm2400("serial:///dev/not_there?baud=1200", clock=InstantClock(), retry=ONCE)
    with pytest.raises(LinkError, match=r"serial:///dev/not_there\?baud=1200,"):
        other.open()
