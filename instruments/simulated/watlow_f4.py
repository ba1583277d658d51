"""A simulated chamber with a Watlow F4S controller: its registers over a chamber machine, served as Modbus RTU.

Register numbers: EspecNorthAmerica/ChamberConnectLibrary (watlowf4.py); 101, 102, 106, 302 to 331 F4P user manual,
Watlow 2003, chapter 9. Profiles are stored, shown, started, held and ended; a started one switches the events of its
step, does not advance and does not change the set point. The clock shows the last time written to it and does not run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from benchctl_instruments.errors import UsageError
from benchctl_instruments.protocols.modbus import ILLEGAL_VALUE, ModbusRefusal
from benchctl_instruments.simulated.machines import ChamberMachine
from benchctl_instruments.simulated.modbus_server import (
    LimitedSetpoint,
    ModbusRtuServer,
    Register,
    RegisterTable,
    constants,
    laid_out,
    scaled,
    signed_word,
    word,
)

HIGH, LOW = 1, 2
SENSOR_C = (-200.0, 800.0)  # a Pt100
UNDER_RANGE, OVER_RANGE = 2, 3
EVENTS = 8
CELSIUS, RTD = 1, 1
CONSTANT, RUNNING, HELD = 0, 2, 3  # register 200
MOST_PROFILES, MOST_STEPS = 40, 256
STEP, STEP_WORDS, TARGET = 4003, 60, 4044  # the step that 4000 and 4001 select
STEP_EVENTS = slice(4030 - STEP, 4038 - STEP)
NO_STEP, END = [6], [5, *[0] * (STEP_WORDS - 1)]  # the type, then its parameters
CREATE, INSERT, DELETE, START = 1, 2, 3, 5  # register 4002
MEMORY = {
    25: (0,),  # 0 saves profiles to the EEPROM
    311: (0,),  # clears input errors
    1060: (0, 1) * 4,  # digital inputs 1 to 4: function, active level
    1916: (12, 0, 0, 1, 1, 2026),  # hour, minute, second, month, day, year
    3500: (ord(" "),) * 10 * MOST_PROFILES,  # names of profiles
}
CONSTANTS = {
    **dict.fromkeys((201, 213, 225, 237), (0,)),  # digital inputs 1 to 4
    600: (RTD,),
    608: (0,),  # unit of input 1: temperature
    901: (CELSIUS,),
    1925: (0,),  # cascade
    4119: (0, 0, 0),  # time left in the step: h, min, s
    4126: (0, 0, 0),  # jumps done, their profile and step
}


@dataclass(slots=True, kw_only=True)
class LatchedAlarm:
    """A process alarm: latched when the air is beyond its set points, until it is cleared with the air inside."""

    low_c: float
    high_c: float
    state: int = 0

    def look(self, air_c: float) -> int:
        """Return the status register: 0 off, 1 high, 2 low."""
        if air_c > self.high_c:
            self.state = HIGH
        elif air_c < self.low_c:
            self.state = LOW
        return self.state


class SimulatedWatlowF4(ModbusRtuServer):
    """A Watlow F4S on a simulated serial line, from `start()` to `stop()` or in a `with`; a driver uses its `address`.

    Parameters
    ----------
    chamber
        The chamber machine.
    decimals
        Digits after the implied decimal point, 0 to 2 (register 606).
    on_event
        The event wired to conditioning; None: the chamber has power and conditions.
    unit_id, pace_baud, over_tcp
        See `ModbusRtuServer`.

    `input_error` (register 101) and `mode` (register 200) may be assigned. An air temperature outside the range of its
    sensor is an input error too.
    """

    def __init__(
        self,
        chamber: ChamberMachine,
        *,
        decimals: int = 1,
        unit_id: int = 1,
        on_event: int | None = 1,
        pace_baud: int | None = None,
        over_tcp: bool = False,
    ) -> None:
        if decimals not in (0, 1, 2):
            raise UsageError(f"decimals = {decimals}: a simulated Watlow F4 has 0, 1 or 2")
        self._chamber = chamber
        self._decimals = decimals
        self._on_event = on_event
        self._events = [0] * EVENTS
        self._alarms = (LatchedAlarm(low_c=-75.0, high_c=185.0), LatchedAlarm(low_c=-80.0, high_c=190.0))
        self._profiles: dict[int, list[list[int]]] = {}  # by number: its steps, each the words from 4003 on
        self._chosen = [1, 1]  # registers 4000 and 4001: profile and step shown in 4003 and the following
        self._started = [0, 0]
        self.input_error = 0
        self.mode = CONSTANT
        if on_event is None:
            chamber.run(True)
        registers = RegisterTable(self._registers(), memory=laid_out(MEMORY))
        super().__init__(registers, unit_id=unit_id, pace_baud=pace_baud, over_tcp=over_tcp)

    def _registers(self) -> list[Register]:
        chamber, (alarm_1, alarm_2) = self._chamber, self._alarms
        setpoint = LimitedSetpoint(chamber, -70.0, 180.0)
        return [
            *constants(laid_out(CONSTANTS)),
            self._scaled(100, chamber.air_c),
            word(101, lambda: self.input_error or _input_error(chamber.air_c())),
            word(102, lambda: alarm_1.look(chamber.air_c())),
            signed_word(103, lambda: round(100 * max(0.0, chamber.power_percent()))),
            word(106, lambda: alarm_2.look(chamber.air_c())),
            signed_word(107, lambda: round(100 * max(0.0, -chamber.power_percent()))),
            word(200, lambda: self.mode),
            self._scaled(300, chamber.setpoint_c, setpoint.put),
            self._scaled(302, lambda: alarm_1.low_c, lambda value: setattr(alarm_1, "low_c", value)),
            self._scaled(303, lambda: alarm_1.high_c, lambda value: setattr(alarm_1, "high_c", value)),
            word(312, lambda: 0, lambda _: setattr(alarm_1, "state", 0)),
            self._scaled(321, lambda: alarm_2.low_c, lambda value: setattr(alarm_2, "low_c", value)),
            self._scaled(322, lambda: alarm_2.high_c, lambda value: setattr(alarm_2, "high_c", value)),
            word(331, lambda: 0, lambda _: setattr(alarm_2, "state", 0)),
            self._scaled(602, lambda: setpoint.low_c, setpoint.put_low),
            self._scaled(603, lambda: setpoint.high_c, setpoint.put_high),
            word(606, lambda: self._decimals),
            word(1209, lambda: 0, lambda _: self._change_mode({HELD: RUNNING}), takes=(1,)),
            word(1210, lambda: 0, lambda _: self._change_mode({RUNNING: HELD}), takes=(1,)),
            word(1217, lambda: 0, lambda _: self._change_mode({RUNNING: CONSTANT, HELD: CONSTANT}), takes=(1,)),
            word(1218, lambda: MOST_PROFILES - len(self._profiles)),
            word(1219, lambda: MOST_STEPS - sum(map(len, self._profiles.values()))),
            *(self._event(number) for number in range(1, EVENTS + 1)),
            word(4000, lambda: self._chosen[0], partial(self._choose, 0), takes=range(1, MOST_PROFILES + 1)),
            word(4001, lambda: self._chosen[1], partial(self._choose, 1), takes=range(1, MOST_STEPS + 1)),
            word(4002, lambda: 0, self._edit),
            *(self._step_word(place) for place in range(STEP_WORDS)),
            word(4100, lambda: self._started[0]),
            word(4101, lambda: self._started[1]),
            word(4122, lambda: self._step(*self._started)[TARGET - STEP]),
        ]

    def _scaled(self, address: int, get: Callable[[], float], put: Callable[[float], None] | None = None) -> Register:
        return scaled(address, get, put, decimals=self._decimals)

    def _event(self, number: int) -> Register:
        def get() -> int:
            return int(self._chamber.running()) if number == self._on_event else self._events[number - 1]

        return word(2000 + 10 * (number - 1), get, partial(self._set_event, number), takes=(0, 1))

    def _set_event(self, number: int, value: int) -> None:
        self._events[number - 1] = value
        if number == self._on_event:
            self._chamber.run(bool(value))

    def _change_mode(self, changes: dict[int, int]) -> None:
        self.mode = changes.get(self.mode, self.mode)

    def _choose(self, place: int, number: int) -> None:
        self._chosen[place] = number

    def _step(self, profile: int, step: int) -> list[int]:
        """Return the words of a step; type 6 if it does not exist."""
        steps = self._profiles.get(profile, [])
        return steps[step - 1] if 1 <= step <= len(steps) else [*NO_STEP, *[0] * (STEP_WORDS - 1)]

    def _step_word(self, place: int) -> Register:
        return word(
            STEP + place,
            lambda: self._step(*self._chosen)[place],
            lambda value: self._step(*self._chosen).__setitem__(place, value),
        )

    def _edit(self, action: int) -> None:
        number, step = self._chosen
        if action == CREATE and len(self._profiles) < MOST_PROFILES:
            free = next(number for number in range(1, MOST_PROFILES + 1) if number not in self._profiles)
            self._profiles[free] = [END.copy()]
            self._chosen = [free, 1]
        elif action == INSERT and number in self._profiles:
            self._profiles[number].insert(step - 1, [0] * STEP_WORDS)
        elif action == DELETE:
            self._profiles.pop(number, None)
        elif action == START and number in self._profiles:
            self.mode, self._started = RUNNING, [number, step]
            for event, value in enumerate(self._step(number, step)[STEP_EVENTS], start=1):
                self._set_event(event, value)
        else:
            raise ModbusRefusal(ILLEGAL_VALUE)


def _input_error(air_c: float) -> int:
    low_c, high_c = SENSOR_C
    return UNDER_RANGE if air_c < low_c else OVER_RANGE if air_c > high_c else 0


Twin = SimulatedWatlowF4
