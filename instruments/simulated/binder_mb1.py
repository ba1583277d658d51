"""A simulated Binder chamber with an MB1 controller: its registers over a chamber machine, served as Modbus RTU.

Registers: ecree-solarflare/ovenctl (its notes, and the dumps of an MK 53's memory), basil `binder_mk53.py`, and P.
Tobiska's control of Binder climate chambers (MKFT 115, MB1). The set point shown is that of manual mode while this is
on, otherwise that of basic mode. Basic mode does not condition, as Tobiska uses it; a program runs until the mode
changes, and keeps the present set point.
"""

from __future__ import annotations

from benchctl_instruments.protocols.modbus import ILLEGAL_VALUE, ModbusRefusal, words_from_f32
from benchctl_instruments.simulated.machines import ChamberMachine
from benchctl_instruments.simulated.modbus_server import (
    ModbusRtuServer,
    Register,
    RegisterTable,
    constants,
    f32,
    laid_out,
    word,
)

IDLE, BASIC, MANUAL, PROGRAM = 0, 0x1000, 0x0800, 0x0400
LOW_C, HIGH_C = -40.0, 180.0
WRITE_DENIED = 5  # 8 in another source
TEXT_WORDS = 20  # one character a word
HUMIDITY_PERCENT = 50.0
SETPOINTS = (0x1581, 0x156F)


class SimulatedBinderMb1(ModbusRtuServer):
    """A Binder MB1 on a simulated serial line, from `start()` to `stop()` or in a `with`; a driver uses its `address`.

    Parameters
    ----------
    chamber
        The chamber machine.
    manual_at
        Register of manual mode's set point: 1581h, or 156Fh as in another source; that of basic mode is the other one.
    write_denied
        The exception that answers a write to a read-only register; sources state 5, or 8.
    unit_id, pace_baud, over_tcp
        See `ModbusRtuServer`.

    `mode`, `alarm`, `note` and `door_open` may be assigned.
    """

    def __init__(
        self,
        chamber: ChamberMachine,
        *,
        manual_at: int = SETPOINTS[0],
        write_denied: int = WRITE_DENIED,
        unit_id: int = 1,
        pace_baud: int | None = None,
        over_tcp: bool = False,
    ) -> None:
        self._chamber = chamber
        self._manual_at = manual_at
        self._setpoints_c = dict.fromkeys(SETPOINTS, chamber.setpoint_c())
        self.mode = MANUAL if chamber.running() else IDLE
        self.alarm = self.note = self.door_open = 0
        memory = laid_out({0x158B: (0,), 0x1A23: (0,)})  # operation lines, number of the program
        registers = RegisterTable(self._registers(), memory=memory, read_only_refusal=write_denied)
        super().__init__(registers, unit_id=unit_id, pace_baud=pace_baud, over_tcp=over_tcp)

    def _registers(self) -> list[Register]:
        humidity = words_from_f32(HUMIDITY_PERCENT, "low_first")
        return [
            f32(0x11A9, self._chamber.air_c, word_order="low_first"),
            f32(0x1077, self._shown_c, word_order="low_first"),
            *(self._setpoint(address) for address in SETPOINTS),
            *constants(laid_out(dict.fromkeys((0x11CD, 0x1079, 0x1583, 0x1571), humidity))),
            *constants(laid_out({0x1228: tuple(b" " * TEXT_WORDS)})),
            word(0x1007, lambda: self.door_open),
            word(0x123D, lambda: self.alarm),
            word(0x123E, lambda: self.note),
            word(0x1A22, lambda: self.mode, self._set_mode, takes=(IDLE, BASIC, MANUAL, PROGRAM)),
        ]

    def _setpoint(self, address: int) -> Register:
        def put(value_c: float) -> None:
            if not LOW_C <= value_c <= HIGH_C:  # also refuses NaN
                raise ModbusRefusal(ILLEGAL_VALUE)
            self._setpoints_c[address] = value_c
            self._obey()

        return f32(address, lambda: self._setpoints_c[address], put, word_order="low_first")

    def _set_mode(self, mode: int) -> None:
        self.mode = mode
        self._obey()
        self._chamber.run(mode in (MANUAL, PROGRAM))

    def _shown_c(self) -> float:
        if self.mode in (MANUAL, PROGRAM):
            return self._chamber.setpoint_c()
        return next(value_c for address, value_c in self._setpoints_c.items() if address != self._manual_at)

    def _obey(self) -> None:
        if self.mode == MANUAL:
            self._chamber.set_setpoint(self._setpoints_c[self._manual_at])


Twin = SimulatedBinderMb1
