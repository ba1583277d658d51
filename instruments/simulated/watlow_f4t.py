"""A simulated chamber with a Watlow F4T controller: its registers over a chamber machine, served as Modbus TCP."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

from instruments.protocols.modbus import DEVICE_FAILURE, ILLEGAL_ADDRESS, ILLEGAL_VALUE, ModbusRefusal
from instruments.protocols.words import WordOrder
from instruments.simulated.machines import ChamberMachine
from instruments.simulated.modbus_server import ModbusTcpServer
from instruments.simulated.registers import Register, RegisterTable, f32, word

PART_NUMBER = "F4T1L1EAA1D1AAA"
AUTO, OFF, ON, NONE, PROFILE_OFF, PRESS = 10, 62, 63, 61, 62, 1457
ALARMS, KEYS = 4, 4
EVENT_ADDRESSES = (16594, 16596, 16598, 16600, 16822, 16824, 16826, 16828)
OUTPUTS = range(33718, 33718 + 6 * 240)  # six modules
AIR_DECIMALS = 3  # what its converter resolves

OnBy = Literal["event", "toggle_key", "momentary_key", "nothing"]


class SimulatedWatlowF4T(ModbusTcpServer):
    """A Watlow F4T, from `start()` to `stop()`, or in a `with`; a driver takes its `address`.

    Parameters
    ----------
    chamber
        What it controls.
    word_order
        Of its singles.
    unit_id
        Its Modbus address.
    loop
        The control loop that the chamber is wired to; it has no other.
    on_by, on_number
        What conditioning is wired to, an event or a key, and its number; "nothing": it conditions, having power.
        The output 1 of module 1 is always on while the chamber runs.
    host, port, pace_baud
        See `ModbusTcpServer`.

    `profile_state` (register 16568) and `control_mode` (registers 2730, 2814) may be set by hand.
    """

    def __init__(
        self,
        chamber: ChamberMachine,
        *,
        word_order: WordOrder = "low_first",
        unit_id: int = 1,
        loop: int = 1,
        on_by: OnBy = "toggle_key",
        on_number: int = 1,
        host: str = "127.0.0.1",
        port: int = 0,
        pace_baud: int | None = None,
    ) -> None:
        self._chamber = chamber
        self._word_order: WordOrder = word_order
        self._loop = loop
        self._on_by: OnBy = on_by
        self._on_place = on_number - 1
        self._limits_c = {"low": -70.0, "high": 180.0}
        self.control_mode = AUTO
        self._events = [OFF] * len(EVENT_ADDRESSES)
        self._keys = [OFF] * KEYS
        self._alarms = [NONE] * ALARMS
        self.profile_state = PROFILE_OFF
        if on_by == "nothing":
            chamber.run(True)
        super().__init__(F4TRegisters(self._registers()), unit_id=unit_id, host=host, port=port, pace_baud=pace_baud)

    def hold_alarm(self, number: int, code: int) -> None:
        """An alarm shows a state from now on, until it is given another one."""
        self._alarms[number - 1] = code

    def _registers(self) -> list[Register]:
        chamber, limits, offset = self._chamber, self._limits_c, 160 * (self._loop - 1)
        part_number = (word(16 + place, _constant(ord(letter))) for place, letter in enumerate(PART_NUMBER))
        return [
            *part_number,
            *(word(1356 + 100 * place, self._state_of(self._alarms, place)) for place in range(ALARMS)),
            word(2730 + offset, lambda: self.control_mode, self._set_mode),
            self._single(2774 + offset, lambda: limits["low"], self._set_low_limit),
            self._single(2776 + offset, lambda: limits["high"], self._set_high_limit),
            self._single(2782 + offset, chamber.setpoint_c, self._set_setpoint),
            self._single(2808 + offset, lambda: round(chamber.power_percent(), 2)),
            self._single(2810 + offset, chamber.setpoint_c),
            word(2814 + offset, lambda: self.control_mode),
            self._single(2820 + offset, lambda: round(chamber.air_c(), AIR_DECIMALS)),
            *(word(6844 + 20 * place, self._state_of(self._keys, place)) for place in range(KEYS)),
            *(word(6850 + 20 * place, lambda: 0, self._press(place)) for place in range(KEYS)),
            word(16568, lambda: self.profile_state),
            *(
                word(address, self._state_of(self._events, place), self._set_event(place))
                for place, address in enumerate(EVENT_ADDRESSES)
            ),
            word(OUTPUTS.start, lambda: ON if chamber.running() else OFF),
        ]

    def _single(self, address: int, get: Callable[[], float], put: Callable[[float], None] | None = None) -> Register:
        return f32(address, get, put, word_order=self._word_order)

    def _state_of(self, states: list[int], place: int) -> Callable[[], int]:
        return lambda: states[place]

    def _set_mode(self, mode: int) -> None:
        if mode not in (AUTO, OFF):
            raise ModbusRefusal(ILLEGAL_VALUE)
        self.control_mode = mode

    def _set_setpoint(self, value_c: float) -> None:
        if not self._limits_c["low"] <= value_c <= self._limits_c["high"]:
            raise ModbusRefusal(ILLEGAL_VALUE)
        self._chamber.set_setpoint(value_c)

    def _set_low_limit(self, value_c: float) -> None:
        if not (math.isfinite(value_c) and value_c < self._limits_c["high"]):
            raise ModbusRefusal(ILLEGAL_VALUE)
        self._limits_c["low"] = value_c

    def _set_high_limit(self, value_c: float) -> None:
        if not (math.isfinite(value_c) and value_c > self._limits_c["low"]):
            raise ModbusRefusal(ILLEGAL_VALUE)
        self._limits_c["high"] = value_c

    def _set_event(self, place: int) -> Callable[[int], None]:
        def put(state: int) -> None:
            if state not in (ON, OFF):
                raise ModbusRefusal(ILLEGAL_VALUE)
            self._events[place] = state
            if place == self._on_place and self._on_by == "event":
                self._chamber.run(state == ON)

        return put

    def _press(self, place: int) -> Callable[[int], None]:
        def put(code: int) -> None:
            if code != PRESS:
                raise ModbusRefusal(ILLEGAL_VALUE)
            momentary = self._on_by == "momentary_key" and place == self._on_place
            if momentary:
                self._chamber.run(not self._chamber.running())
                return
            self._keys[place] = OFF if self._keys[place] == ON else ON
            if self._on_by == "toggle_key" and place == self._on_place:
                self._chamber.run(self._keys[place] == ON)

        return put


class F4TRegisters(RegisterTable):
    """The F4T's registers; an output that is not fitted is no illegal address but a failure of the device."""

    def read(self, address: int, count: int) -> list[int]:
        """`count` words from `address` on."""
        try:
            return super().read(address, count)
        except ModbusRefusal as refusal:
            if refusal.code == ILLEGAL_ADDRESS and address in OUTPUTS:
                raise ModbusRefusal(DEVICE_FAILURE) from refusal
            raise


def _constant(value: int) -> Callable[[], int]:
    return lambda: value


Twin = SimulatedWatlowF4T
