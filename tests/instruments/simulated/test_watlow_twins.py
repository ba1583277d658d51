"""The simulated controllers as a foreign program sees them: pymodbus' own clients, and literal bytes on the line."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import serial
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.client.mixin import ModbusClientMixin

from benchctl_instruments.errors import UsageError
from benchctl_instruments.links.address import parse_address
from benchctl_instruments.simulated.watlow_f4 import SimulatedWatlowF4
from benchctl_instruments.simulated.watlow_f4t import SimulatedWatlowF4T
from tests.instruments.chamber_machine import FakeChamber

FLOAT32 = ModbusClientMixin.DATATYPE.FLOAT32


@pytest.fixture
def machine() -> FakeChamber:
    return FakeChamber()


@pytest.fixture
def f4(machine: FakeChamber) -> Iterator[ModbusSerialClient]:
    with SimulatedWatlowF4(machine) as twin:
        client = ModbusSerialClient(parse_address(twin.address).pyserial_url, baudrate=115200, timeout=0.5)
        client.connect()
        yield client
        client.close()  # type: ignore[no-untyped-call]


@pytest.fixture
def f4t(machine: FakeChamber) -> Iterator[ModbusTcpClient]:
    with SimulatedWatlowF4T(machine) as twin:
        client = ModbusTcpClient("127.0.0.1", port=parse_address(twin.address).port, timeout=0.5)
        client.connect()  # type: ignore[no-untyped-call]
        yield client
        client.close()  # type: ignore[no-untyped-call]


def as_float(client: ModbusTcpClient, address: int) -> float:
    words = client.read_holding_registers(address, count=2).registers
    value = client.convert_from_registers(words, FLOAT32, word_order="little")
    assert isinstance(value, float)
    return value


def float_words(value: float) -> list[int]:
    words = ModbusClientMixin.convert_to_registers(value, FLOAT32, word_order="little")
    return [int(word) for word in words]


@pytest.mark.parametrize(
    ("air_c", "decimals", "reply"),
    [
        (25.0, 1, "01 03 02 00 FA 38 07"),  # 250 tenths
        (-40.0, 1, "01 03 02 FE 70 F9 C0"),  # -400 tenths
        (-12.34, 0, "01 03 02 FF F4 F8 33"),  # -12
        (-12.34, 2, "01 03 02 FB 2E 7B 68"),  # -1234 hundredths
        (500.0, 2, "01 03 02 7F FF D8 34"),  # as far as the register goes
    ],
)
def test_a_temperature_is_these_bytes_on_the_f4s_line(
    machine: FakeChamber, air_c: float, decimals: int, reply: str
) -> None:
    machine.air = air_c
    with (
        SimulatedWatlowF4(machine, decimals=decimals) as twin,
        serial.serial_for_url(parse_address(twin.address).pyserial_url, timeout=1.0) as port,
    ):
        port.write(bytes.fromhex("01 03 00 64 00 01 C5 D5"))
        assert port.read(7) == bytes.fromhex(reply)


def test_the_f4_takes_a_negative_set_point_and_refuses_one_beyond_its_limits(
    f4: ModbusSerialClient, machine: FakeChamber
) -> None:
    assert not f4.write_register(602, 0x10000 - 450).isError()
    assert not f4.write_register(300, 0x10000 - 400).isError()
    assert machine.setpoint == -40.0
    for beyond in (0x10000 - 451, 1801, 0x8000):
        assert f4.write_register(300, beyond).exception_code == 3
    assert machine.setpoint == -40.0
    assert f4.read_holding_registers(300).registers == [0xFE70]


def test_the_f4_says_heating_and_cooling_on_two_outputs(f4: ModbusSerialClient, machine: FakeChamber) -> None:
    for power, outputs in ((50.5, [5050, 0]), (-25.0, [0, 2500])):
        machine.power = power
        assert [f4.read_holding_registers(address).registers[0] for address in (103, 107)] == outputs


def test_the_f4_conditions_while_its_event_is_on(f4: ModbusSerialClient, machine: FakeChamber) -> None:
    seen = []
    for address, state in ((2000, 1), (2010, 1), (2000, 0)):
        assert not f4.write_register(address, state).isError()
        seen.append(machine.running())
    assert seen == [True, True, False]
    assert f4.read_holding_registers(2010).registers == [1]
    assert f4.write_register(2000, 2).exception_code == 3


def test_the_f4_latches_an_alarm_until_it_is_cleared_with_the_air_inside(
    f4: ModbusSerialClient, machine: FakeChamber
) -> None:
    assert not f4.write_register(303, 300).isError()  # alarm 1 above 30.0 °C
    states: list[int] = []
    for air_c in (31.0, 29.0):
        machine.air = air_c
        states += f4.read_holding_registers(102).registers
    f4.write_register(312, 0)
    states += f4.read_holding_registers(102).registers
    assert states == [1, 1, 0]


def test_the_f4_refuses_what_it_does_not_have(f4: ModbusSerialClient) -> None:
    assert f4.read_holding_registers(319).exception_code == 2  # an F4S has no second channel
    assert f4.read_holding_registers(102, count=3).exception_code == 2
    assert f4.write_register(100, 0).exception_code == 2
    assert f4.read_coils(0).exception_code == 1
    assert f4.write_register(602, 1800).exception_code == 3  # low above high
    assert f4.write_register(603, 0x10000 - 700).exception_code == 3


def test_the_f4_has_no_more_than_two_decimals(machine: FakeChamber) -> None:
    with pytest.raises(UsageError, match="decimals = 3: a simulated Watlow F4 has 0, 1 or 2"):
        SimulatedWatlowF4(machine, decimals=3)


def test_the_f4t_sends_its_singles_low_word_first(f4t: ModbusTcpClient, machine: FakeChamber) -> None:
    machine.air, machine.power = -40.5, 12.25
    assert f4t.read_holding_registers(2820, count=2).registers == [0x0000, 0xC222]
    assert as_float(f4t, 2820) == -40.5
    assert as_float(f4t, 2808) == 12.25
    assert as_float(f4t, 2810) == 20.0


def test_the_f4t_takes_a_set_point_and_refuses_what_lies_beyond_its_limits_or_is_no_number(
    f4t: ModbusTcpClient, machine: FakeChamber
) -> None:
    assert not f4t.write_registers(2776, float_words(85.0)).isError()
    assert not f4t.write_registers(2782, float_words(84.5)).isError()
    for wrong in (85.5, float("nan"), float("inf")):
        assert f4t.write_registers(2782, float_words(wrong)).exception_code == 3
    assert f4t.write_registers(2774, float_words(85.0)).exception_code == 3
    assert f4t.write_registers(2776, float_words(-70.0)).exception_code == 3
    assert machine.setpoint == 84.5


def test_half_a_single_can_be_read_from_the_f4t_but_not_written(f4t: ModbusTcpClient, machine: FakeChamber) -> None:
    machine.air = 25.0
    assert f4t.read_holding_registers(2821).registers == [0x41C8]
    assert f4t.write_register(2783, 0x41C8).exception_code == 2
    assert f4t.write_register(2782, 0).exception_code == 2
    assert machine.setpoint == 20.0


def test_the_f4t_says_its_part_number_a_letter_a_register(f4t: ModbusTcpClient) -> None:
    letters = f4t.read_holding_registers(16, count=15).registers
    assert bytes(letters) == b"F4T1L1EAA1D1AAA"


def test_the_f4ts_toggle_key_is_switched_on_by_down_and_off_by_up(f4t: ModbusTcpClient, machine: FakeChamber) -> None:
    seen = []
    for press in (1457, 1457, 1456, 1456):
        assert not f4t.write_register(6850, press).isError()
        seen.append((machine.on, *(f4t.read_holding_registers(address).registers[0] for address in (6844, 33718))))
    assert seen == [(True, 63, 63)] * 2 + [(False, 62, 62)] * 2
    assert f4t.write_register(6850, 1).exception_code == 3


def test_the_f4ts_bus_speaks_the_unit_that_it_is_set_to(f4t: ModbusTcpClient, machine: FakeChamber) -> None:
    machine.air = 25.0
    assert not f4t.write_register(6730, 30).isError()
    assert as_float(f4t, 2820) == pytest.approx(77.0)
    assert not f4t.write_registers(2782, float_words(86.0)).isError()
    assert machine.setpoint == pytest.approx(30.0)


@pytest.mark.parametrize(("alarms", "letter"), [(6, "D"), (8, "E"), (14, "F")])
def test_the_f4ts_part_number_states_its_alarms_and_loops(machine: FakeChamber, alarms: int, letter: str) -> None:
    with SimulatedWatlowF4T(machine, alarms=alarms, loop=3) as twin:
        client = ModbusTcpClient("127.0.0.1", port=parse_address(twin.address).port, timeout=0.5)
        client.connect()  # type: ignore[no-untyped-call]
        assert bytes(client.read_holding_registers(16, count=15).registers) == f"F4T1L1{letter}AA1D3AAA".encode()
        assert client.read_holding_registers(1356 + 100 * (alarms - 1)).registers == [61]
        assert client.read_holding_registers(1356 + 100 * alarms).exception_code == 2
        assert [client.read_holding_registers(2814 + 160 * loop).registers for loop in range(3)] == [[10]] * 3
        assert client.read_holding_registers(16536, count=6).registers == [1540, 0] * 3  # temperatures, each of them
        assert client.read_holding_registers(2814 + 160 * 3).exception_code == 2
        client.close()  # type: ignore[no-untyped-call]
    with pytest.raises(UsageError, match="alarms = 7, loop = 1: a simulated Watlow F4T has 6, 8 or 14 alarms"):
        SimulatedWatlowF4T(machine, alarms=7)


def test_the_f4t_has_one_output_and_answers_for_the_others_with_a_failure(f4t: ModbusTcpClient) -> None:
    assert f4t.read_holding_registers(33718 + 40).exception_code == 4
    assert f4t.read_holding_registers(33718 + 240).exception_code == 4
    assert f4t.read_holding_registers(40000).exception_code == 2


def test_the_f4t_takes_only_states_that_it_knows(f4t: ModbusTcpClient) -> None:
    for address, known, unknown in ((2730, 54, 1), (16594, 63, 1), (16828, 62, 10)):
        assert not f4t.write_register(address, known).isError()
        assert f4t.read_holding_registers(address).registers == [known]
        assert f4t.write_register(address, unknown).exception_code == 3
    assert f4t.read_holding_registers(2814).registers == [54]
