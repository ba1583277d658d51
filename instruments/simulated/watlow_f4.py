"""A simulated chamber with a Watlow F4S controller: its registers over a chamber machine, served as Modbus RTU."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from instruments.errors import UsageError
from instruments.protocols.modbus import ILLEGAL_VALUE, ModbusRefusal
from instruments.simulated.machines import ChamberMachine
from instruments.simulated.modbus_server import ModbusRtuServer
from instruments.simulated.registers import Register, RegisterTable, signed_word, word

HIGH, LOW = 1, 2
SENSOR_C = (-200.0, 800.0)  # a Pt100
UNDER_RANGE, OVER_RANGE = 2, 3
EVENTS = 8
CELSIUS = 1


@dataclass(slots=True, kw_only=True)
class LatchedAlarm:
    """A process alarm: latched when the air is found beyond its set points, until it is cleared with the air inside."""

    low_c: float
    high_c: float
    state: int = 0

    def look(self, air_c: float) -> int:
        """The status register: 0 off, 1 high, 2 low."""
        if air_c > self.high_c:
            self.state = HIGH
        elif air_c < self.low_c:
            self.state = LOW
        return self.state


class SimulatedWatlowF4(ModbusRtuServer):
    """A Watlow F4S on a simulated serial line, from `start()` to `stop()` or in a `with`; a driver takes its `address`.

    Parameters
    ----------
    chamber
        What it controls.
    decimals
        Digits behind the implied decimal point, 0 to 2 (register 606).
    unit_id
        Its Modbus address.
    on_event
        The event wired to conditioning; None: the chamber has power and conditions.
    pace_baud
        Bytes move as a line at this speed would let them; None: at once.
    over_tcp
        Serial over TCP instead of a pseudo-terminal.

    `input_error` (register 101) and `mode` (register 200) may be set by hand. An air temperature beyond what its sensor
    measures is an input error too.
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
        self._limits_c = {"low": -70.0, "high": 180.0}
        self._alarms = (LatchedAlarm(low_c=-75.0, high_c=185.0), LatchedAlarm(low_c=-80.0, high_c=190.0))
        self.input_error = 0
        self.mode = 0
        if on_event is None:
            chamber.run(True)
        super().__init__(RegisterTable(self._registers()), unit_id=unit_id, pace_baud=pace_baud, over_tcp=over_tcp)

    def _registers(self) -> list[Register]:
        chamber, limits, (alarm_1, alarm_2) = self._chamber, self._limits_c, self._alarms
        return [
            self._scaled(100, chamber.air_c),
            word(101, lambda: self.input_error or _input_error(chamber.air_c())),
            word(102, lambda: alarm_1.look(chamber.air_c())),
            signed_word(103, lambda: round(100 * max(0.0, chamber.power_percent()))),
            word(106, lambda: alarm_2.look(chamber.air_c())),
            signed_word(107, lambda: round(100 * max(0.0, -chamber.power_percent()))),
            word(200, lambda: self.mode),
            self._scaled(300, chamber.setpoint_c, self._set_setpoint),
            self._scaled(302, lambda: alarm_1.low_c, lambda value: setattr(alarm_1, "low_c", value)),
            self._scaled(303, lambda: alarm_1.high_c, lambda value: setattr(alarm_1, "high_c", value)),
            word(312, lambda: 0, lambda _: setattr(alarm_1, "state", 0)),
            self._scaled(321, lambda: alarm_2.low_c, lambda value: setattr(alarm_2, "low_c", value)),
            self._scaled(322, lambda: alarm_2.high_c, lambda value: setattr(alarm_2, "high_c", value)),
            word(331, lambda: 0, lambda _: setattr(alarm_2, "state", 0)),
            self._scaled(602, lambda: limits["low"], self._set_low_limit),
            self._scaled(603, lambda: limits["high"], self._set_high_limit),
            word(606, lambda: self._decimals),
            word(901, lambda: CELSIUS),
            *(self._event(number) for number in range(1, EVENTS + 1)),
        ]

    def _scaled(self, address: int, get: Callable[[], float], put: Callable[[float], None] | None = None) -> Register:
        """A temperature with the implied decimal point, at the end of its range where it does not fit."""
        step = 10**self._decimals
        return signed_word(
            address,
            lambda: max(-0x8000, min(0x7FFF, round(get() * step))),
            None if put is None else lambda value: put(value / step),
        )

    def _set_setpoint(self, value_c: float) -> None:
        if not self._limits_c["low"] <= value_c <= self._limits_c["high"]:
            raise ModbusRefusal(ILLEGAL_VALUE)
        self._chamber.set_setpoint(value_c)

    def _set_low_limit(self, value_c: float) -> None:
        if value_c >= self._limits_c["high"]:
            raise ModbusRefusal(ILLEGAL_VALUE)
        self._limits_c["low"] = value_c

    def _set_high_limit(self, value_c: float) -> None:
        if value_c <= self._limits_c["low"]:
            raise ModbusRefusal(ILLEGAL_VALUE)
        self._limits_c["high"] = value_c

    def _event(self, number: int) -> Register:
        def put(value: int) -> None:
            if value not in (0, 1):
                raise ModbusRefusal(ILLEGAL_VALUE)
            self._events[number - 1] = value
            if number == self._on_event:
                self._chamber.run(bool(value))

        def get() -> int:
            return int(self._chamber.running()) if number == self._on_event else self._events[number - 1]

        return word(2000 + 10 * (number - 1), get, put)


def _input_error(air_c: float) -> int:
    low_c, high_c = SENSOR_C
    return UNDER_RANGE if air_c < low_c else OVER_RANGE if air_c > high_c else 0


Twin = SimulatedWatlowF4
