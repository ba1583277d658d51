"""A simulated chamber with a Watlow F4T controller: its registers over a chamber machine, served as Modbus TCP or RTU.

Register numbers: EspecNorthAmerica/ChamberConnectLibrary (watlowf4t.py); 1328, 2794 to 2798, 6730 Watlow's and
TestEquity's F4T manuals. No profile is stored: a started one runs, but does not advance. The clock shows the last time
written to it and does not run.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Literal

from benchctl_instruments.errors import UsageError
from benchctl_instruments.protocols.modbus import (
    DEVICE_FAILURE,
    ILLEGAL_ADDRESS,
    ModbusRefusal,
    WordOrder,
    words_from_f32,
)
from benchctl_instruments.simulated.faults.wires import MODBUS_RTU, MODBUS_TCP, Wire
from benchctl_instruments.simulated.machines import ChamberMachine
from benchctl_instruments.simulated.modbus_server import (
    LimitedSetpoint,
    ModbusRtuServer,
    ModbusTcpServer,
    Register,
    RegisterTable,
    constants,
    f32,
    laid_out,
    word,
)
from benchctl_instruments.simulated.serial_line import Served

AUTO, MANUAL, OFF, ON, NONE = 10, 54, 62, 63, 61
CELSIUS, FAHRENHEIT = 15, 30
ETHERNET_UNIT, SERIAL_UNIT = 6730, 14080
BAUD = 38400
UP, DOWN = 1456, 1457
PAUSE, RESUME, TERMINATE, RUNNING, START = 146, 147, 148, 149, 1782
SAFE, NO, MINUTES, ABSOLUTE_TEMPERATURE = 1667, 59, 57, 1540
FUNCTIONS_OF = {6: "D", 8: "E", 14: "F"}  # of the part number, by alarms; all three with profiles
KEYS, LOOPS = 4, 4
EVENT_ADDRESSES = (16594, 16596, 16598, 16600, 16822, 16824, 16826, 16828)
OUTPUTS = range(33718, 33718 + 6 * 240)  # six modules
AIR_DECIMALS = 3  # resolution of its converter
PROFILES = 40
LIMIT_MODULE = 60 * (5 - 1)  # the only one, in slot 5
MEMORY = {
    1328: (CELSIUS, 0),  # unit on the panel
    ETHERNET_UNIT: (CELSIUS, 0),  # of the temperatures on this bus
    SERIAL_UNIT: (CELSIUS, 0),
    14664: (12, 0, 0, 0, 0, 0, 1, 0, 1, 0, 2026, 0),  # clock: h, min, s, month, day, year
    16558: (1, 0, 1, 0),  # profile and step to start
    18888: (1, 0),  # profile to edit
    37546: (NO, 0, *[0] * 158) * 4,  # messages: shown?, text
}
CONSTANTS = {
    11250 + LIMIT_MODULE: (NONE, 0),  # state
    11264 + LIMIT_MODULE: (SAFE, 0),  # status
    11288 + LIMIT_MODULE: (NONE, 0),  # error
    16570: (0, 0, 0, 0),  # time left: min, h
    16622: (0,) * 6,  # time left in the step: s, min, h
    16886: (0,) * 40 * PROFILES,  # names
    18920: (0, 0),  # steps of the profile to edit
}
RAMP, RAMP_SINGLES = {2794: OFF, 2796: MINUTES}, {2784: 0.0, 2798: 1.0}  # of each loop, with its manual power
IDLE = {2730: AUTO, 2814: AUTO}  # of a loop without a chamber
IDLE_SINGLES = {2774: -70.0, 2776: 180.0, 2782: 0.0, 2808: 0.0, 2810: 0.0, 2820: 0.0}

OnBy = Literal["event", "toggle_key", "momentary_key", "nothing"]


class SimulatedWatlowF4T(Served):
    """A Watlow F4T, from `start()` to `stop()`, or in a `with`; a driver uses its `address`.

    Parameters
    ----------
    chamber
        The chamber machine.
    word_order
        Word order of its singles.
    unit_id
        Its Modbus address.
    loop
        The control loop that the chamber is wired to; it is the last of its loops.
    alarms
        The number of its alarms: 6, 8 or 14.
    on_by, on_number
        The event or key to which conditioning is wired, and its number; "nothing": it conditions while it has power.
        The output 1 of module 1 is always on while the chamber runs.
    over_tcp
        Modbus TCP; otherwise RTU on a serial line, whose unit is another one.
    pace_baud
        See `ModbusTcpServer`.

    Its part number states its loops and alarms. `memory` (the units of the buses, 6730 and 14080), `profile_state`
    (register 16568) and `control_mode` (2730, 2814) may be assigned.
    """

    wire: Wire = MODBUS_TCP

    def __init__(
        self,
        chamber: ChamberMachine,
        *,
        word_order: WordOrder = "low_first",
        unit_id: int = 1,
        loop: int = 1,
        alarms: int = 8,
        on_by: OnBy = "toggle_key",
        on_number: int = 1,
        over_tcp: bool = True,
        pace_baud: int | None = None,
    ) -> None:
        if alarms not in FUNCTIONS_OF or not 1 <= loop <= LOOPS:
            raise UsageError(
                f"alarms = {alarms}, loop = {loop}: a simulated Watlow F4T has 6, 8 or 14 alarms and 1 to {LOOPS} loops"
            )
        self._chamber = chamber
        self._word_order: WordOrder = word_order
        self._loop = loop
        self._on_by: OnBy = on_by
        self._on_place = on_number - 1
        self._part_number = f"F4T1L1{FUNCTIONS_OF[alarms]}AA1D{loop}AAA"
        self._events = [OFF] * len(EVENT_ADDRESSES)
        self._keys = [OFF] * KEYS
        self._alarms = [NONE] * alarms
        self.control_mode = AUTO
        self.profile_state = OFF
        if on_by == "nothing":
            chamber.run(True)
        self.memory = laid_out(MEMORY)
        for number in range(1, loop + 1):
            codes = RAMP if number == loop else RAMP | IDLE
            singles = RAMP_SINGLES if number == loop else RAMP_SINGLES | IDLE_SINGLES
            self.memory |= laid_out({address + 160 * (number - 1): (code,) for address, code in codes.items()})
            for address, value in singles.items():
                self.memory |= laid_out({address + 160 * (number - 1): words_from_f32(value, word_order)})
        self._unit_at = ETHERNET_UNIT if over_tcp else SERIAL_UNIT
        registers = F4TRegisters(self._registers(), memory=self.memory)
        if over_tcp:
            super().__init__(ModbusTcpServer(registers, unit_id=unit_id, pace_baud=pace_baud))
        else:
            self.wire = MODBUS_RTU
            super().__init__(ModbusRtuServer(registers, unit_id=unit_id, baud=BAUD, pace_baud=pace_baud))

    def hold_alarm(self, number: int, code: int) -> None:
        """Set the state of an alarm until it is set again."""
        self._alarms[number - 1] = code

    def _registers(self) -> list[Register]:
        chamber, offset = self._chamber, 160 * (self._loop - 1)
        setpoint = LimitedSetpoint(chamber, -70.0, 180.0)
        return [
            *constants(laid_out({16: tuple(self._part_number.encode()), **CONSTANTS})),
            *constants(laid_out({16536: (ABSOLUTE_TEMPERATURE, 0) * self._loop})),  # quantity of the profiles' loops
            *(word(1356 + 100 * place, self._state_of(self._alarms, place)) for place in range(len(self._alarms))),
            word(2730 + offset, lambda: self.control_mode, self._set_mode, takes=(AUTO, MANUAL, OFF)),
            self._temperature(2774 + offset, lambda: setpoint.low_c, setpoint.put_low),
            self._temperature(2776 + offset, lambda: setpoint.high_c, setpoint.put_high),
            self._temperature(2782 + offset, chamber.setpoint_c, setpoint.put),
            f32(2808 + offset, lambda: round(chamber.power_percent(), 2), word_order=self._word_order),
            self._temperature(2810 + offset, chamber.setpoint_c),
            word(2814 + offset, lambda: self.control_mode),
            self._temperature(2820 + offset, lambda: round(chamber.air_c(), AIR_DECIMALS)),
            *(word(6844 + 20 * place, self._state_of(self._keys, place)) for place in range(KEYS)),
            *(
                word(6850 + 20 * place, lambda: UP, partial(self._press, place), takes=(UP, DOWN))
                for place in range(KEYS)
            ),
            word(16562, lambda: NONE, self._order_profile, takes=(START,)),
            word(16564, lambda: NONE, self._order_profile, takes=(RESUME,)),
            word(16566, lambda: NONE, self._order_profile, takes=(PAUSE, TERMINATE)),
            word(16568, lambda: self.profile_state),
            word(16588, lambda: self.memory[16558]),
            word(16590, lambda: self.memory[16560]),
            *(
                word(address, self._state_of(self._events, place), partial(self._set_event, place), takes=(ON, OFF))
                for place, address in enumerate(EVENT_ADDRESSES)
            ),
            word(18890, lambda: NONE, lambda _: None),
            word(OUTPUTS.start, lambda: ON if chamber.running() else OFF),
        ]

    def _state_of(self, states: list[int], place: int) -> Callable[[], int]:
        return lambda: states[place]

    def _temperature(
        self, address: int, get: Callable[[], float], put: Callable[[float], None] | None = None
    ) -> Register:
        """Return registers of a temperature in the unit of the bus."""

        def shown() -> float:
            return get() * 1.8 + 32.0 if self.memory[self._unit_at] == FAHRENHEIT else get()

        def take(value: float) -> None:
            if put is not None:
                put((value - 32.0) / 1.8 if self.memory[self._unit_at] == FAHRENHEIT else value)

        return f32(address, shown, None if put is None else take, word_order=self._word_order)

    def _set_mode(self, mode: int) -> None:
        self.control_mode = mode

    def _order_profile(self, code: int) -> None:
        self.profile_state = {START: RUNNING, RESUME: RUNNING, PAUSE: PAUSE, TERMINATE: OFF}[code]

    def _set_event(self, place: int, state: int) -> None:
        self._events[place] = state
        if place == self._on_place and self._on_by == "event":
            self._chamber.run(state == ON)

    def _press(self, place: int, code: int) -> None:
        """Press a key: 1457 switches a toggle key on and 1456 off; each 1457 of a momentary key starts or stops."""
        wired = place == self._on_place
        if wired and self._on_by == "momentary_key":
            if code == DOWN:
                self._chamber.run(not self._chamber.running())
            return
        self._keys[place] = ON if code == DOWN else OFF
        if wired and self._on_by == "toggle_key":
            self._chamber.run(code == DOWN)


class F4TRegisters(RegisterTable):
    """The F4T's registers; an output that is not fitted gives a device failure instead of an illegal address."""

    def read(self, address: int, count: int) -> list[int]:
        """Return `count` words from `address` on."""
        try:
            return super().read(address, count)
        except ModbusRefusal as refusal:
            if refusal.code == ILLEGAL_ADDRESS and address in OUTPUTS:
                raise ModbusRefusal(DEVICE_FAILURE) from refusal
            raise


Twin = SimulatedWatlowF4T
