"""A simulated Binder chamber with an MB2 controller: its registers over a chamber machine, served as Modbus RTU."""

from __future__ import annotations

import math

from instruments.protocols.modbus import DEVICE_FAILURE, ILLEGAL_ADDRESS, ILLEGAL_VALUE, ModbusRefusal
from instruments.protocols.words import WordOrder
from instruments.simulated.machines import ChamberMachine
from instruments.simulated.modbus_server import ModbusRtuServer
from instruments.simulated.registers import Register, RegisterTable, f32, u32, word

NOT_READY = DEVICE_FAILURE  # Binder's own meaning of exception 4
WRITE_DENIED = 8  # 5 in another source
IDLE = 1 << 1  # bit of the operation contacts
CONTACTS = 0x01FF
LOW_C, HIGH_C = -70.0, 180.0


class SimulatedBinderMb2(ModbusRtuServer):
    """A Binder MB2 on a simulated serial line, from `start()` to `stop()` or in a `with`; a driver takes its `address`.

    Parameters
    ----------
    chamber
        What it controls.
    word_order
        Of its singles.
    write_denied
        The exception that answers a write where none is allowed; sources say 8, or 5.
    unit_id, pace_baud, over_tcp
        See `ModbusRtuServer`.

    While it idles the set point that it shows is `idle_c`, not that of manual mode. `program_left_s` above zero says
    that a program runs, which denies manual operation; while `ready` is false, every request is answered with exception
    4. All three, and `contacts`, may be set by hand.
    """

    def __init__(
        self,
        chamber: ChamberMachine,
        *,
        word_order: WordOrder = "low_first",
        write_denied: int = WRITE_DENIED,
        unit_id: int = 1,
        pace_baud: int | None = None,
        over_tcp: bool = False,
    ) -> None:
        self._chamber = chamber
        self._word_order: WordOrder = word_order
        self._write_denied = write_denied
        self.contacts = 0 if chamber.running() else IDLE
        self.idle_c = 20.0
        self.program_left_s = 0
        self.ready = True
        registers = BinderRegisters(self, write_denied)
        super().__init__(registers, unit_id=unit_id, pace_baud=pace_baud, over_tcp=over_tcp)

    def registers(self) -> list[Register]:
        """What it keeps, for `BinderRegisters`."""
        order = self._word_order
        return [
            f32(0x1004, self._chamber.air_c, word_order=order),
            u32(0x10A6, lambda: 60 if self.program_left_s else 0),
            u32(0x10A8, lambda: self.program_left_s),
            f32(0x10B2, self._obeyed_c, word_order=order),
            f32(0x10D2, self._chamber.air_c, word_order=order),
            f32(0x114C, _cannot_be_read, self._set_setpoint, word_order=order),
            word(0x1158, lambda: self.contacts, self._set_contacts),
            word(0x1292, lambda: self.contacts),
        ]

    def _obeyed_c(self) -> float:
        return self.idle_c if self.contacts & IDLE else self._chamber.setpoint_c()

    def _set_setpoint(self, value_c: float) -> None:
        if not (math.isfinite(value_c) and LOW_C <= value_c <= HIGH_C):
            raise ModbusRefusal(ILLEGAL_VALUE)
        self._chamber.set_setpoint(value_c)

    def _set_contacts(self, contacts: int) -> None:
        if self.program_left_s:
            raise ModbusRefusal(self._write_denied)
        if contacts & ~CONTACTS:
            raise ModbusRefusal(ILLEGAL_VALUE)
        self.contacts = contacts
        self._chamber.run(not contacts & IDLE)


class BinderRegisters(RegisterTable):
    """The MB2's registers, while it is ready."""

    def __init__(self, twin: SimulatedBinderMb2, write_denied: int) -> None:
        self._twin = twin
        super().__init__(twin.registers(), read_only_refusal=write_denied)

    def read(self, address: int, count: int) -> list[int]:
        """`count` words from `address` on."""
        self._be_ready()
        return super().read(address, count)

    def write(self, address: int, values: list[int]) -> None:
        """Write whole quantities from `address` on."""
        self._be_ready()
        super().write(address, values)

    def _be_ready(self) -> None:
        if not self._twin.ready:
            raise ModbusRefusal(NOT_READY)


def _cannot_be_read() -> float:
    """No source reads the set point of manual mode, so here nobody can."""
    raise ModbusRefusal(ILLEGAL_ADDRESS)


Twin = SimulatedBinderMb2
