"""A simulated Binder chamber with an MB2 controller: its registers over a chamber machine, served as Modbus RTU.

Registers: P. Tobiska, control of Binder climate chambers, version 20200630 (MKFT 115, MB2). Humidity and time are
constant: a started program does not advance until it is stopped, and the clock shows the last time written to it.
"""

from __future__ import annotations

from benchctl_instruments.protocols.modbus import (
    DEVICE_FAILURE,
    ILLEGAL_ADDRESS,
    ILLEGAL_VALUE,
    ModbusRefusal,
    WordOrder,
    words_from_f32,
)
from benchctl_instruments.simulated.machines import ChamberMachine
from benchctl_instruments.simulated.modbus_server import (
    LimitedSetpoint,
    ModbusRtuServer,
    Register,
    RegisterTable,
    constants,
    f32,
    laid_out,
    u32,
    word,
)

NOT_READY = DEVICE_FAILURE  # Binder's own meaning of exception 4
WRITE_DENIED = 8  # 5 in another source
IDLE = 1 << 1  # bit of the operation contacts
CONTACTS = 0x01FF
HUMIDITY_PERCENT, FAN_PERCENT = 50.0, 100.0
BUSY, DELETE, LOAD, STORE = 0x0080, 0x0006, 0x000B, 0x000C  # of register 3000h
PROGRAM = range(0x3003, 0x4320)  # the program that is loaded or about to be stored: segments of 30h words, then a title
SEGMENT_WORDS, DURATION = 0x30, 0x3038  # of the first segment: seconds, low word first
MEMORY = {
    0x1140: (2026, 1, 1, 12, 0, 0, 0, 0, 1),  # start of a program: time, and a 0; its number and segment
    0x134A: (2026, 1, 1, 12, 0, 0),  # clock
    0x3001: (0,),
    PROGRAM.start: (0,) * len(PROGRAM),
}


class SimulatedBinderMb2(ModbusRtuServer):
    """A Binder MB2 on a simulated serial line, from `start()` to `stop()` or in a `with`; a driver uses its `address`.

    Parameters
    ----------
    chamber
        The chamber machine.
    word_order
        Word order of its singles.
    write_denied
        The exception that answers a write where none is allowed; sources state 8, or 5.
    unit_id, pace_baud, over_tcp
        See `ModbusRtuServer`.

    While it idles, the set point shown is `idle_c`, not that of manual mode. `program_left_s` above zero means that a
    program is running, which denies manual operation; while `ready` is false, every request is answered with exception
    4. All three, and `contacts`, may be assigned.
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
        self.write_denied = write_denied
        self._memory = laid_out(MEMORY)
        self._programs: dict[int, dict[int, int]] = {}  # by number, as the words of `PROGRAM` by address
        self._status = 0
        self.contacts = 0 if chamber.running() else IDLE
        self.idle_c = 20.0
        self.program_left_s = 0
        self.ready = True
        registers = BinderRegisters(self, self._registers(), self._memory)
        super().__init__(registers, unit_id=unit_id, pace_baud=pace_baud, over_tcp=over_tcp)

    def _registers(self) -> list[Register]:
        order, air_c = self._word_order, self._chamber.air_c
        humidity, fan = words_from_f32(HUMIDITY_PERCENT, order), words_from_f32(FAN_PERCENT, order)
        setpoint = LimitedSetpoint(self._chamber, -70.0, 180.0)
        return [
            *(f32(address, air_c, word_order=order) for address in (0x1004, 0x1006, 0x1008, 0x100C, 0x10D0, 0x10D2)),
            *constants(laid_out({**dict.fromkeys((0x100A, 0x10B4, 0x10D4, 0x10D6), humidity), 0x10B6: fan})),
            word(0x10A4, lambda: self._memory[0x1147]),
            word(0x10A5, lambda: self._memory[0x1148]),
            u32(0x10A6, lambda: 60 if self.program_left_s else 0),
            u32(0x10A8, lambda: self.program_left_s),
            f32(0x10B2, self._obeyed_c, word_order=order),
            word(0x1149, lambda: 0, self._start_program, takes=(1,)),
            word(0x114A, lambda: 0, self._stop_program, takes=(1,)),
            word(0x114B, lambda: 0, lambda _: None),
            f32(0x114C, _cannot_be_read, setpoint.put, word_order=order),
            f32(0x114E, _cannot_be_read, lambda _: None, word_order=order),
            f32(0x1150, _cannot_be_read, lambda _: None, word_order=order),
            word(0x1158, lambda: self.contacts, self._set_contacts),
            word(0x1292, lambda: self.contacts),
            word(0x3000, lambda: 0, self._manage_programs),
            word(0x3002, lambda: self._status),
        ]

    def _obeyed_c(self) -> float:
        return self.idle_c if self.contacts & IDLE else self._chamber.setpoint_c()

    def _set_contacts(self, contacts: int) -> None:
        if self.program_left_s:
            raise ModbusRefusal(self.write_denied)
        if contacts & ~CONTACTS:
            raise ModbusRefusal(ILLEGAL_VALUE)
        self.contacts = contacts
        self._chamber.run(not contacts & IDLE)

    def _manage_programs(self, command: int) -> None:
        """Load, store or delete the program whose number and words are in `PROGRAM`; status 0: done."""
        number = self._memory[PROGRAM.start + 1]
        command &= ~BUSY
        self._status = int(command == LOAD and number not in self._programs)
        if command == LOAD:
            self._memory.update(self._programs.get(number, {}))
        elif command == STORE:
            self._programs[number] = {address: self._memory[address] for address in PROGRAM}
        elif command == DELETE:
            self._programs.pop(number, None)
        else:
            raise ModbusRefusal(ILLEGAL_VALUE)

    def _start_program(self, _: int) -> None:
        program = self._programs.get(self._memory[0x1147])
        if program is None:
            raise ModbusRefusal(ILLEGAL_VALUE)
        durations = range(DURATION, DURATION + SEGMENT_WORDS * program[PROGRAM.start], SEGMENT_WORDS)
        self.program_left_s = sum(program[at] + (program[at + 1] << 16) for at in durations)

    def _stop_program(self, _: int) -> None:
        self.program_left_s = 0


class BinderRegisters(RegisterTable):
    """The MB2's registers, readable and writable while it is ready."""

    def __init__(self, twin: SimulatedBinderMb2, registers: list[Register], memory: dict[int, int]) -> None:
        self._twin = twin
        super().__init__(registers, memory=memory, read_only_refusal=twin.write_denied)

    def read(self, address: int, count: int) -> list[int]:
        """Return `count` words from `address` on."""
        self._be_ready()
        return super().read(address, count)

    def write(self, address: int, values: list[int]) -> None:
        """Write complete quantities from `address` on."""
        self._be_ready()
        super().write(address, values)

    def _be_ready(self) -> None:
        if not self._twin.ready:
            raise ModbusRefusal(NOT_READY)


def _cannot_be_read() -> float:
    """Refuse to read: no source reads the set points of manual mode."""
    raise ModbusRefusal(ILLEGAL_ADDRESS)


Twin = SimulatedBinderMb2
