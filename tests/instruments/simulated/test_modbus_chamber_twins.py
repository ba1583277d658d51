"""The simulated controllers as a foreign program sees them: pymodbus' own client, and literal bytes on the line."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import serial
from pymodbus.client import ModbusSerialClient
from pymodbus.client.mixin import ModbusClientMixin

from benchctl_instruments.errors import UsageError
from benchctl_instruments.links.address import parse_address
from benchctl_instruments.simulated.binder_mb1 import SimulatedBinderMb1
from benchctl_instruments.simulated.binder_mb2 import SimulatedBinderMb2
from benchctl_instruments.simulated.csz_ezt430i import SimulatedCszEzt430i
from benchctl_instruments.simulated.eurotherm_2400 import SimulatedEurotherm2400
from benchctl_instruments.simulated.eurotherm_3500 import SimulatedEurotherm3500
from benchctl_instruments.simulated.modbus_server import ModbusRtuServer
from tests.instruments.chamber_machine import FakeChamber

FLOAT32 = ModbusClientMixin.DATATYPE.FLOAT32


@pytest.fixture
def machine() -> FakeChamber:
    return FakeChamber()


@contextmanager
def client_of(twin: ModbusRtuServer) -> Iterator[ModbusSerialClient]:
    with twin:
        client = ModbusSerialClient(parse_address(twin.address).pyserial_url, baudrate=115200, timeout=0.5)
        client.connect()
        yield client
        client.close()  # type: ignore[no-untyped-call]


def single(value: float, word_order: str) -> list[int]:
    words = ModbusClientMixin.convert_to_registers(value, FLOAT32, word_order=word_order)  # type: ignore[arg-type]
    return [int(word) for word in words]


def test_the_line_takes_the_time_that_its_speed_says(machine: FakeChamber) -> None:
    bytes_moved, byte_s = 8 + 9, 10 / 9600
    with client_of(SimulatedCszEzt430i(machine, pace_baud=9600)) as client:
        started_s = time.monotonic()
        assert client.read_holding_registers(35, count=2).registers == [230, 200]
        assert time.monotonic() - started_s >= bytes_moved * byte_s


def test_the_manuals_own_example_is_answered_with_the_manuals_own_bytes(machine: FakeChamber) -> None:
    """EZT-430i Communications Manual, revision C, page 4.8."""
    machine.air, machine.setpoint = 78.1, 49.9
    with (
        SimulatedCszEzt430i(machine) as twin,
        serial.serial_for_url(parse_address(twin.address).pyserial_url, timeout=1.0) as port,
    ):
        port.write(bytes.fromhex("01 03 00 23 00 02 35 C1"))
        assert port.read(9) == bytes.fromhex("01 03 04 03 0D 01 F3 2A 61")


@pytest.mark.parametrize(("decimals", "word"), [(0, 345), (1, 3450), (2, 0x7FFF)])
def test_the_ezts_decimal_point_is_implied(machine: FakeChamber, decimals: int, word: int) -> None:
    machine.air = 345.0
    with client_of(SimulatedCszEzt430i(machine, decimals=decimals)) as client:
        assert client.read_holding_registers(35).registers == [word]
    with pytest.raises(UsageError, match="decimals = 4: a simulated EZT-430i has 0 to 3"):
        SimulatedCszEzt430i(machine, decimals=4)


def test_the_ezt_acknowledges_function_16_and_carries_it_out_for_programs_alone(machine: FakeChamber) -> None:
    with client_of(SimulatedCszEzt430i(machine)) as client:
        for values in ([500, 0], [500]):
            assert not client.write_registers(36, values).isError()
            assert machine.setpoint == 20.0
        assert not client.write_register(36, 500).isError()
        assert machine.setpoint == 50.0
        assert not client.write_registers(100, list(range(14))).isError()
        assert client.read_holding_registers(100, count=14).registers == list(range(14))


def test_the_ezt_refuses_what_it_does_not_have_or_what_lies_beyond_its_limits(machine: FakeChamber) -> None:
    twin = SimulatedCszEzt430i(machine)
    with client_of(twin) as client:
        assert client.read_holding_registers(5, count=3).exception_code == 2
        assert client.write_register(35, 0).exception_code == 2
        assert client.write_register(36, 2001).exception_code == 3
        assert client.write_register(12, 0x40).exception_code == 3
        assert client.write_register(1, 2).exception_code == 3
        assert client.read_coils(0).exception_code == 1
        assert not client.write_register(11, 1).isError()
    assert (twin.reserved_writes, machine.setpoint) == (1, 20.0)


def test_the_ezts_alarm_is_latched_until_it_is_reset_with_the_air_back(machine: FakeChamber) -> None:
    states: list[int] = []
    with client_of(SimulatedCszEzt430i(machine)) as client:
        for air_c, reset in ((191.0, 0), (191.0, 1), (23.0, 0), (23.0, 1)):
            machine.air = air_c
            client.write_register(1, reset)
            states += client.read_holding_registers(5).registers
    assert states == [1, 1, 1, 0]


@pytest.mark.parametrize("make", [SimulatedEurotherm2400, SimulatedEurotherm3500])
def test_a_eurotherm_parameter_has_two_addresses(
    machine: FakeChamber, make: type[SimulatedEurotherm2400 | SimulatedEurotherm3500]
) -> None:
    machine.air = -40.04
    with client_of(make(machine)) as client:
        assert client.read_holding_registers(1).registers == [0x10000 - 400]
        assert client.read_holding_registers(0x8002, count=2).registers == single(-40.04, "big")
        assert not client.write_registers(0x8004, single(33.33, "big")).isError()
        assert client.read_holding_registers(2).registers == [333]
        assert not client.write_register(2, 0x10000 - 55).isError()
        assert client.read_holding_registers(0x8004, count=2).registers == single(-5.5, "big")


def test_a_eurotherm_with_two_decimals_ends_at_327_67(machine: FakeChamber) -> None:
    machine.air = 400.0
    with client_of(SimulatedEurotherm3500(machine, decimals=2)) as client:
        assert client.read_holding_registers(1).registers == [0x7FFF]
        assert client.read_holding_registers(0x8002, count=2).registers == single(400.0, "big")
    with pytest.raises(UsageError, match="decimals = 3: a simulated Eurotherm has 0, 1 or 2"):
        SimulatedEurotherm2400(machine, decimals=3)


def test_every_write_of_a_set_point_wears_the_eurotherms_eeprom(machine: FakeChamber) -> None:
    twin = SimulatedEurotherm2400(machine)
    with client_of(twin) as client:
        for setpoint in (250, 250, 251):
            client.write_register(2, setpoint)
        assert client.write_registers(0x8004, single(900.0, "big")).exception_code == 3
        assert client.write_registers(0x8004, single(float("nan"), "big")).exception_code == 3
    assert twin.eeprom_writes == 3


def test_manual_mode_alone_freezes_a_eurotherms_output(machine: FakeChamber) -> None:
    machine.on, machine.power = True, 62.5
    with client_of(SimulatedEurotherm2400(machine)) as client:
        assert client.write_register(3, 0).exception_code == 3  # its own affair in automatic mode
        client.write_register(273, 1)
        machine.power = 10.0
        assert (client.read_holding_registers(3).registers, machine.on) == ([625], True)
        client.write_register(3, 0)
        assert (client.read_holding_registers(3).registers, machine.on) == ([0], False)
        client.write_register(273, 0)
        assert (client.read_holding_registers(3).registers, machine.on) == ([100], True)
        assert client.write_register(273, 2).exception_code == 3


def test_a_broken_sensor_shows_in_the_2400s_status_and_in_the_3500s_alarm_summary(machine: FakeChamber) -> None:
    for twin, of_2400, of_3500 in (
        (SimulatedEurotherm2400(machine), True, None),
        (SimulatedEurotherm3500(machine), False, [1]),
    ):
        twin.sensor_broken = True
        with client_of(twin) as client:
            assert client.read_holding_registers(289).registers == [13720]
            for address, shows in (
                (258, [1] if of_2400 else None),
                (75, [1 << 5] if of_2400 else None),
                (10213, of_3500),
            ):
                answer = client.read_holding_registers(address)
                assert answer.exception_code == 2 if shows is None else answer.registers == shows


def test_the_3500_has_no_output_and_no_status_word_where_the_2400_has_them(machine: FakeChamber) -> None:
    with client_of(SimulatedEurotherm3500(machine)) as client:
        assert [client.read_holding_registers(address).exception_code for address in (3, 75, 258)] == [2, 2, 2]
        machine.power = 12.5
        client.write_register(273, 0)
        assert client.read_holding_registers(85).registers == [125]


def test_a_eurotherm_obeys_the_one_of_two_set_points_that_is_selected(machine: FakeChamber) -> None:
    twin = SimulatedEurotherm2400(machine)
    with client_of(twin) as client:
        client.write_register(24, 300)
        client.write_register(25, 800)
        seen = []
        for selected in (1, 0):
            client.write_register(15, selected)
            seen.append([client.read_holding_registers(number).registers[0] for number in (2, 5, 24, 25)])
    assert seen == [[800, 800, 300, 800], [300, 300, 300, 800]]
    assert (machine.setpoint, twin.eeprom_writes) == (30.0, 2)


def test_the_mb2_sends_its_singles_low_word_first_and_obeys_while_it_does_not_idle(machine: FakeChamber) -> None:
    machine.air = -40.5
    with client_of(SimulatedBinderMb2(machine)) as client:
        assert client.read_holding_registers(0x10D2, count=2).registers == [0x0000, 0xC222]
        assert client.read_holding_registers(0x1004, count=2).registers == [0x0000, 0xC222]
        assert not client.write_registers(0x114C, single(60.0, "little")).isError()
        assert client.read_holding_registers(0x10B2, count=2).registers == single(20.0, "little")
        assert not client.write_register(0x1158, 0).isError()
        assert client.read_holding_registers(0x10B2, count=2).registers == single(60.0, "little")
        assert client.read_holding_registers(0x1292).registers == [0]
    assert machine.on


@pytest.mark.parametrize("write_denied", [5, 8])
def test_the_mb2_refuses_what_its_sources_say(machine: FakeChamber, write_denied: int) -> None:
    twin = SimulatedBinderMb2(machine, write_denied=write_denied)
    with client_of(twin) as client:
        assert client.read_holding_registers(0x114C, count=2).exception_code == 2
        assert client.write_registers(0x114C, single(181.0, "little")).exception_code == 3
        assert client.write_registers(0x10D2, single(20.0, "little")).exception_code == write_denied
        assert client.write_register(0x1158, 0x8000).exception_code == 3
        twin.program_left_s = 70_000
        assert client.read_holding_registers(0x10A6, count=4).registers == [0, 60, 1, 70_000 - 0x10000]
        assert client.write_register(0x1158, 0).exception_code == write_denied
        twin.ready = False
        assert client.read_holding_registers(0x1292).exception_code == 4
    assert (machine.on, machine.setpoint) == (False, 20.0)


@pytest.mark.parametrize(
    "make",
    [SimulatedBinderMb1, SimulatedBinderMb2, SimulatedCszEzt430i, SimulatedEurotherm2400, SimulatedEurotherm3500],
)
def test_it_answers_as_the_unit_it_is_told_to_be_over_tcp_too(
    machine: FakeChamber,
    make: type[
        SimulatedBinderMb1 | SimulatedBinderMb2 | SimulatedCszEzt430i | SimulatedEurotherm2400 | SimulatedEurotherm3500
    ],
) -> None:
    twin = make(machine, unit_id=9, over_tcp=True)
    with client_of(twin) as client:
        assert twin.address.startswith("socket://")
        assert client.read_holding_registers(0xFFFF, device_id=9).exception_code == 2
