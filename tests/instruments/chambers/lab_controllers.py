"""Two controllers that nobody knows, written for the tests of profiles, with the profiles that a lab would write."""

from __future__ import annotations

from benchctl_instruments.protocols.modbus import (
    ILLEGAL_ADDRESS,
    ILLEGAL_VALUE,
    ModbusRefusal,
    f32_from_words,
    signed_from_word,
    words_from_f32,
)
from tests.instruments.chamber_machine import FakeChamber

ACME = """
name = "Acme 9"
source = "Acme 9 interface manual, edition 2, chapter 4"
manufacturer = "Acme"
model = "9"

[transport]
functions = [3, 6, 16]
unit_id = 7
baud = 38400
word_order = "low_first"
runs = [{ first = 512, count = 6 }, { first = 520, count = 4 }, { first = 550, count = 2 }]
restricted = [[600, 699]]

[[checks]]
name = "temperature unit"
address = 575
expected = [1]
advice = "set it to degrees Celsius"

[busy]
address = 574
wait_s = 2

[air]
address = 512
kind = "f32"
invalid = { "9999.0" = "sensor open", "-9999.0" = "sensor shorted" }

[setpoint]
address = 516
kind = "f32"
also = [530]
taken = { address = 514, kind = "f32" }
run = { address = 540, value = 5 }

[low_limit]
address = 520
kind = "f32"

[high_limit]
address = 522
kind = "f32"

[heating]
address = 550
kind = "u16"
decimals = 1

[cooling]
address = 551
kind = "u16"
decimals = 1

[[input_errors]]
name = "input"
address = 572
words = { 1 = "is open", 0x02 = "is shorted" }

[[alarms]]
name = "safety"
address = 570
bits = { 0 = "compressor pressure", 3 = "door open" }
clear = { address = 571, value = 1 }

[[modes]]
name = "a recipe"
address = 573
fine = [0, 9]
words = { 1 = "runs" }

[switch]
by = "key"
address = 560
press = 1
shown = 561
on = 1
off = 0
mask = 1
"""

ACME_LIMITS = """
[low_limit]
address = 520
kind = "f32"

[high_limit]
address = 522
kind = "f32"
"""
ACME_WITHOUT_LIMITS = "kept_limits_c = [-70.0, 180.0]" + ACME.replace(ACME_LIMITS, "")


class Acme9:
    """A `RegisterMap`: singles low word first, only its runs may be read, a set point waits for 5 in register 540.

    A press of its key (register 560) starts or stops it; bit 0 of register 561 says which, the other bits blink. Its
    `words` are its status registers. `touched` counts requests that came near the registers 600 to 699.
    """

    RUNS = ((512, 6), (520, 4), (550, 2))
    ALONE = (530, 540, 560, 561, 570, 571, 572, 573, 574, 575)

    def __init__(self, chamber: FakeChamber) -> None:
        self.chamber = chamber
        self.waiting_c = chamber.setpoint
        self.second_c = 0.0
        self.limits_c = [-70.0, 180.0]
        self.words = {570: 0, 572: 0, 573: 0, 574: 0, 575: 1}
        self.presses = 0
        self.clearings = 0
        self.touched = 0

    def read(self, address: int, count: int) -> list[int]:
        self._see(address, count)
        if (address, count) == (512, 6):
            return [word for value in (self.chamber.air, self.chamber.setpoint, self.waiting_c) for word in _low(value)]
        if (address, count) == (520, 4):
            return [word for value in self.limits_c for word in _low(value)]
        if (address, count) == (550, 2):
            return [round(10 * max(0.0, self.chamber.power)), round(10 * max(0.0, -self.chamber.power))]
        if (address, count) == (530, 2):
            return _low(self.second_c)
        if count == 1 and address == 561:
            return [0xA0 | self.chamber.on]
        if count == 1 and address in self.words:
            return [self.words[address]]
        raise ModbusRefusal(ILLEGAL_ADDRESS)

    def write(self, address: int, values: list[int]) -> None:
        self._see(address, len(values))
        if address in (516, 520, 522, 530) and len(values) == 2:
            self._set(address, f32_from_words(values, "low_first"))
        elif (address, values) == (540, [5]):
            self.chamber.set_setpoint(self.waiting_c)
        elif (address, values) == (560, [1]):
            self.presses += 1
            self.chamber.run(not self.chamber.on)
        elif (address, values) == (571, [1]):
            self.clearings += 1
        else:
            raise ModbusRefusal(ILLEGAL_VALUE)

    def _set(self, address: int, value: float) -> None:
        if address == 516:
            self.waiting_c = value
        elif address == 530:
            self.second_c = value
        else:
            self.limits_c[address == 522] = value

    def _see(self, address: int, count: int) -> None:
        self.touched += address <= 699 and address + count > 600


def _low(value: float) -> list[int]:
    return words_from_f32(value, "low_first")


BRAND = """
name = "Brand X"
source = "what the service engineer wrote on the door"
decimals_register = 20
kept_limits_c = [-40.0, 150.0]

[transport]
functions = [3, 6]
most_registers = 2

[air]
address = 10
kind = "signed"
invalid = { 32767 = "over range", "-32768" = "under range" }
valid_c = [-100.0, 300.0]

[setpoint]
address = 11
kind = "signed"
wears = true

[cooling]
address = 12
kind = "u16"
decimals = 0

[switch]
by = "register"
address = 30
on = 0x0800
off = 0x1000
mask = 0x1C00
after_off = [{ address = 31, kind = "u16", decimals = 0, value = 0 }]
"""


class BrandX:
    """A `RegisterMap` of whole numbers, at most two a request; registers 10 to 12, 20, 30, 31."""

    def __init__(self, chamber: FakeChamber, *, decimals: int = 1) -> None:
        self.chamber = chamber
        self.decimals = decimals
        self.output = 55
        self.raw_air: int | None = None
        self.most_asked = 0
        self.setpoint_writes = 0
        self.output_is_locked = False

    def read(self, address: int, count: int) -> list[int]:
        self.most_asked = max(self.most_asked, count)
        step = 10**self.decimals
        air = round(self.chamber.air * step) if self.raw_air is None else self.raw_air
        words = {
            10: air & 0xFFFF,
            11: round(self.chamber.setpoint * step) & 0xFFFF,
            12: round(max(0.0, -self.chamber.power)),
            20: self.decimals,
            30: 0x0001 | (0x0800 if self.chamber.on else 0x1000),
            31: self.output,
        }
        if count > 2 or not all(place in words for place in range(address, address + count)):
            raise ModbusRefusal(ILLEGAL_ADDRESS)
        return [words[place] for place in range(address, address + count)]

    def write(self, address: int, values: list[int]) -> None:
        if len(values) != 1:
            raise ModbusRefusal(ILLEGAL_ADDRESS)
        if address == 11:
            self.setpoint_writes += 1
            self.chamber.set_setpoint(signed_from_word(values[0]) / 10**self.decimals)
        elif (address, values[0]) in ((30, 0x0800), (30, 0x1000)):
            self.chamber.run(values[0] == 0x0800)
        elif address == 31 and not self.output_is_locked:
            self.output = values[0]
        else:
            raise ModbusRefusal(ILLEGAL_VALUE)
