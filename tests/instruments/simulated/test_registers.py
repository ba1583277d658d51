"""The declared register table: what it gives, what it takes, what it refuses."""

from __future__ import annotations

import pytest

from benchctl_instruments.protocols.modbus import ILLEGAL_ADDRESS, ILLEGAL_VALUE, ModbusRefusal
from benchctl_instruments.simulated.modbus_server import (
    LimitedSetpoint,
    RegisterTable,
    constants,
    f32,
    laid_out,
    scaled,
    signed_word,
    u32,
    word,
)
from tests.instruments.chamber_machine import FakeChamber


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
    with pytest.raises(ValueError, match="register 13 is declared twice"):
        RegisterTable([word(13, lambda: 0)], memory={13: 0})


def test_memory_keeps_what_is_written_among_declared_quantities_and_constants_do_not() -> None:
    memory = laid_out({9: (1,), 16: (2, 3)})
    device = Device()
    table = RegisterTable(
        [word(10, lambda: device.number, device.set_number), *constants(laid_out({11: (4, 5)}))], memory=memory
    )
    assert table.read(9, 4) == [1, 7, 4, 5]
    table.write(9, [6, 8])
    table.write(16, [9, 0xFFFF])
    assert (memory, device.number) == ({9: 6, 16: 9, 17: 0xFFFF}, 8)
    with pytest.raises(ModbusRefusal):
        table.write(9, [0, 0, 0])
    assert memory[9] == 6


def test_a_word_takes_only_the_values_that_it_declares() -> None:
    taken: list[int] = []
    table = RegisterTable([word(1, lambda: 0, taken.append, takes=(62, 63))])
    table.write(1, [63])
    with pytest.raises(ModbusRefusal) as refused:
        table.write(1, [1])
    assert (taken, refused.value.code) == ([63], ILLEGAL_VALUE)


@pytest.mark.parametrize(
    ("value", "shown"), [(-40.04, 0x10000 - 400), (1e9, 0x7FFF), (-1e9, 0x8000), (float("nan"), 0x7FFF)]
)
def test_a_number_with_an_implied_point_stops_at_the_end_of_its_register(value: float, shown: int) -> None:
    assert RegisterTable([scaled(1, lambda: value, decimals=1)]).read(1, 1) == [shown]


def test_a_set_point_and_its_limits_keep_their_order() -> None:
    chamber = FakeChamber()
    setpoint = LimitedSetpoint(chamber, -70.0, 180.0)
    for put, wrong in (
        (setpoint.put, (180.1, -70.1, float("nan"))),
        (setpoint.put_low, (180.0, float("nan"), float("-inf"))),
        (setpoint.put_high, (-70.0, float("nan"), float("inf"))),
    ):
        for value in wrong:
            with pytest.raises(ModbusRefusal, match="exception 3"):
                put(value)
    setpoint.put(180.0)
    setpoint.put_high(90.0)
    assert (chamber.setpoint, setpoint.low_c, setpoint.high_c) == (180.0, -70.0, 90.0)
