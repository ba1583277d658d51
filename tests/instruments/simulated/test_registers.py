"""The declared register table: what it gives, what it takes, what it refuses."""

from __future__ import annotations

import pytest

from instruments.protocols.modbus import ILLEGAL_ADDRESS, ILLEGAL_VALUE, ModbusRefusal
from instruments.simulated.registers import RegisterTable, f32, signed_word, u32, word


class Device:
    """A little of everything."""

    def __init__(self) -> None:
        self.number = 7
        self.tenths = -400
        self.air_c = 25.0
        self.serial = 0x00112233
        self.asked = 0

    def ask_air(self) -> float:
        self.asked += 1
        return self.air_c

    def set_number(self, value: int) -> None:
        if value > 9:
            raise ModbusRefusal(ILLEGAL_VALUE)
        self.number = value

    def table(self) -> RegisterTable:
        return RegisterTable(
            [
                word(10, lambda: self.number, self.set_number),
                signed_word(11, lambda: self.tenths, lambda value: setattr(self, "tenths", value)),
                f32(12, self.ask_air, lambda value: setattr(self, "air_c", value), word_order="low_first"),
                u32(14, lambda: self.serial),
            ],
            read_only_refusal=ILLEGAL_VALUE,
        )


def test_a_read_may_span_quantities_of_every_kind() -> None:
    assert Device().table().read(10, 6) == [7, 0xFE70, 0x0000, 0x41C8, 0x0011, 0x2233]


def test_both_words_of_a_number_come_from_one_instant() -> None:
    device = Device()
    device.table().read(12, 2)
    assert device.asked == 1


def test_half_a_number_can_be_read_but_not_written() -> None:
    device = Device()
    assert device.table().read(13, 2) == [0x41C8, 0x0011]
    for address, values in ((12, [0]), (13, [0]), (11, [0, 0])):
        with pytest.raises(ModbusRefusal) as refused:
            device.table().write(address, values)
        assert refused.value.code == ILLEGAL_ADDRESS
    assert (device.tenths, device.air_c) == (-400, 25.0)


def test_a_write_may_span_quantities_and_keeps_their_signs() -> None:
    device = Device()
    device.table().write(10, [3, 0xFFFF, 0x0000, 0xC222])
    assert (device.number, device.tenths, device.air_c) == (3, -1, -40.5)


def test_what_is_not_declared_is_refused_also_in_the_middle() -> None:
    table = RegisterTable([word(1, lambda: 0, lambda _: None), word(3, lambda: 0, lambda _: None)])
    for address, count in ((0, 1), (1, 3), (3, 2)):
        with pytest.raises(ModbusRefusal) as refused:
            table.read(address, count)
        assert refused.value.code == ILLEGAL_ADDRESS
        with pytest.raises(ModbusRefusal):
            table.write(address, [0] * count)


def test_what_is_read_only_is_refused_as_the_device_does_and_nothing_before_it_is_written() -> None:
    device = Device()
    with pytest.raises(ModbusRefusal) as refused:
        device.table().write(12, [0, 0, 0, 0])
    assert refused.value.code == ILLEGAL_VALUE
    assert device.air_c == 25.0


def test_the_device_may_refuse_a_value() -> None:
    device = Device()
    with pytest.raises(ModbusRefusal, match=r"exception 3 \(illegal data value\)"):
        device.table().write(10, [10])
    assert device.number == 7


def test_two_quantities_in_one_register_are_a_mistake_in_the_table() -> None:
    with pytest.raises(ValueError, match="register 13 is declared twice"):
        RegisterTable([f32(12, lambda: 0.0), word(13, lambda: 0)])
