"""A simulated LabJack T7: its registers on Modbus TCP and its spontaneous stream on a separate socket.

Its registers are LabJack's: inputs, DIO_EF and stream have effects, `t7_register_map` lists the others. In addition to
the functions of Modbus it supports Modbus Feedback (76), which LabJack's library and async_labjack use. An unknown
register is refused with the exception "illegal data address". It is stricter than the T7 in one way: while a stream
runs, inputs cannot be read singly, and neither they nor the stream can be configured; such requests are refused with
error 2605.

The scan interval is a multiple of 100 ns, at most 65536 steps; a longer one takes steps of 200 ns, 400 ns, ... That the
steps double is an assumption based on the T7's timers; LabJack only states "rounding".
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TypeVar

from benchctl_instruments.errors import UsageError
from benchctl_instruments.protocols.modbus import DEVICE_FAILURE, ILLEGAL_ADDRESS, ILLEGAL_VALUE, ModbusRefusal
from benchctl_instruments.protocols.t7_stream import MOST_SAMPLES
from benchctl_instruments.simulated import t7_register_map as labjack
from benchctl_instruments.simulated.faults.schedule import PendingFaults
from benchctl_instruments.simulated.faults.stream_faults import StreamFault
from benchctl_instruments.simulated.faults.wires import MODBUS_TCP, Wire
from benchctl_instruments.simulated.machines import AnalogInputs
from benchctl_instruments.simulated.modbus_server import ModbusTcpServer, Register, RegisterTable, f32, u32, word
from benchctl_instruments.simulated.serial_line import Served
from benchctl_instruments.simulated.t7_register_map import EF_ENABLE, EF_INDEX, RANGE, T7Terminals
from benchctl_instruments.simulated.t7_stream_server import StreamBuffer, StreamSettings, T7StreamServer

Number = TypeVar("Number", int, float)

CORE_HZ = 40_000_000
SCAN_CLOCK_HZ, LONGEST_COUNT = 10_000_000, 1 << 16
CORE_AT_START = 0xF000_0000  # not zero: it has been on for a while, and wraps soon
DEFAULT_BUFFER_BYTES, LARGEST_BUFFER_BYTES = 4096, 32768
ETHERNET = 1
SERIAL = 470_012_345
FEEDBACK, FEEDBACK_FRAME = 76, struct.Struct(">BHB")  # LabJack's own function; of a frame: 1 writes, address, registers

STREAM_RUNS, LIST_INVALID, RATE_INVALID, TARGET_INVALID = 2605, 2607, 2608, 2612
BUFFER_INVALID, PACKET_INVALID, NOT_RUNNING = 2615, 2618, 2620
NO_CODE = 0  # refused, but LabJack's code for it is not known here

RATE, LENGTH, PACKET, BUFFER, TARGET, DATATYPE, BURST = 4002, 4004, 4006, 4012, 4016, 4018, 4020
SCAN_LIST = 4100
CONFIGURATION = (range(4000, 5000), range(40000, 44000))  # not writable while a stream runs
AINS, DIOS = range(labjack.ANALOG_INPUTS), range(labjack.DIGITAL_LINES)
NAME, NAME_WORDS = 60500, 25
REBOOT = 0x4C4A  # in the upper half of SYSTEM_REBOOT

KINDS: dict[labjack.Kind, Callable[..., Register]] = {"u16": word, "u32": u32, "f32": f32}
AS_DELIVERED: dict[int, float] = {address: value for address, _, value in labjack.each(labjack.KEPT)} | {RATE: 0.0}


class SimulatedLabJackT7(Served):
    """A T7 at `address` and `stream_address`, from `start()` to `stop()`, or in a `with`.

    Parameters
    ----------
    inputs
        The signals at its terminals.
    encoder_channel, gyro_ain, thermistor_ain
        The wiring of the terminals, as in `T7Terminals`.
    """

    wire: Wire = MODBUS_TCP

    def __init__(
        self,
        inputs: AnalogInputs,
        *,
        encoder_channel: int = 0,
        gyro_ain: int = 0,
        thermistor_ain: int = 1,
    ) -> None:
        self._inputs = inputs
        self._settings = dict(AS_DELIVERED)
        self._terminals = T7Terminals(
            inputs, self._settings, encoder_channel=encoder_channel, gyro_ain=gyro_ain, thermistor_ain=thermistor_ain
        )
        self._last_error = self._last_exception = 0
        self._name = [0] * NAME_WORDS
        self._flash_pointer = 0
        self._started = 0  # CORE_TIMER at the first scan
        self._stream = T7StreamServer(inputs)
        self._table = RegisterTable(self._registers())
        super().__init__(ModbusTcpServer(self, unit_id=None, functions={FEEDBACK: self._carry_out_feedback}))

    @property
    def stream_address(self) -> str:
        """`tcp://HOST:PORT` of its stream."""
        return self._stream.address

    @property
    def stream_faults(self) -> PendingFaults[StreamFault] | None:
        """The faults of its stream's packets; to be set before the start."""
        return self._stream.faults

    @stream_faults.setter
    def stream_faults(self, faults: PendingFaults[StreamFault] | None) -> None:
        self._stream.faults = faults

    def restart(self) -> None:
        """Restart, as after a power failure: no stream, every setting as delivered, encoder lines at rest."""
        self._stream.end()
        self._settings |= AS_DELIVERED
        self._terminals.zero = 0

    def start(self) -> None:
        """Serve; when it returns, a driver can connect."""
        self._stream.start()
        try:
            super().start()
        except UsageError:  # its port is in use
            self._stream.stop()
            raise

    def stop(self) -> None:
        """Close everything; safe to call twice."""
        super().stop()
        self._stream.stop()

    def read(self, address: int, count: int) -> list[int]:
        """Return `count` words from `address` on."""
        with self._noting_refusals():
            return self._table.read(address, count)

    def write(self, address: int, values: list[int]) -> None:
        """Write words from `address` on."""
        with self._noting_refusals():
            self._table.write(address, values)

    @contextmanager
    def _noting_refusals(self) -> Iterator[None]:
        try:
            yield
        except ModbusRefusal as refusal:
            self._last_exception = refusal.code
            if refusal.code != DEVICE_FAILURE:
                self._last_error = NO_CODE
            raise

    def _carry_out_feedback(self, frames: bytes) -> bytes:
        """Execute reads and writes in order and return the words read. Frames before a refused one remain executed."""
        words: list[int] = []
        while frames:
            if len(frames) < FEEDBACK_FRAME.size:
                raise ModbusRefusal(ILLEGAL_VALUE)
            writes, address, count = FEEDBACK_FRAME.unpack_from(frames)
            data, frames = frames[FEEDBACK_FRAME.size :], frames[FEEDBACK_FRAME.size + 2 * count * writes :]
            if not count or writes > 1 or (writes and len(data) < 2 * count):
                raise ModbusRefusal(ILLEGAL_VALUE)
            if writes:
                self.write(address, list(struct.unpack_from(f">{count}H", data)))
            else:
                words += self.read(address, count)
        return struct.pack(f">{len(words)}H", *words)

    def _registers(self) -> list[Register]:
        return [
            *(self._setting(address, kind) for address, kind, _ in labjack.each(labjack.KEPT)),
            *(
                KINDS[kind](address, partial(float if kind == "f32" else int, value))
                for address, kind, value in labjack.each(labjack.STATED)
            ),
            *(
                KINDS[kind](address, _write_only, lambda value: None)
                for address, kind, _ in labjack.each(labjack.ACCEPTED)
            ),
            *(self._all_inputs(*row) for row in labjack.ALL_INPUTS.items()),
            f32(RATE, lambda: scan_rate(self._settings[RATE]), lambda value: self._keep(RATE, value)),
            u32(4026, lambda: self._started),
            u32(4990, lambda: int(self._stream.running), self._enable),
            word(55000, lambda: self._last_error),
            word(55001, lambda: self._last_exception),
            u32(60028, lambda: SERIAL),
            Register(address=NAME, words=NAME_WORDS, read=lambda: self._name, write=partial(setattr, self, "_name")),
            u32(61520, lambda: self._core_timer(self._inputs.now())),
            u32(61522, lambda: math.floor(self._inputs.now() * 20)),
            u32(61810, lambda: self._flash_pointer, lambda value: setattr(self, "_flash_pointer", value)),
            Register(address=61812, words=labjack.CALIBRATION_WORDS, read=lambda: labjack.flash(self._flash_pointer)),
            u32(61998, _write_only, lambda value: self.restart() if value >> 16 == REBOOT else None),
            *(f32(2 * ain, partial(self._at_rest, self._terminals.single_volts, ain)) for ain in AINS),
            *(u32(50000 + 2 * ain, partial(self._at_rest, self._terminals.single_code, ain)) for ain in AINS),
            *(u32(3000 + 2 * dio, partial(self._at_rest, self._terminals.count, dio)) for dio in DIOS),
            *(u32(3100 + 2 * dio, partial(self._at_rest, self._terminals.count, dio, reset=True)) for dio in DIOS),
        ]

    def _setting(self, address: int, kind: labjack.Kind) -> Register:
        """Return a register that stores a number; an input's range is rounded up to a valid one (0: the largest)."""
        return KINDS[kind](address, lambda: self._settings[address], lambda value: self._keep(address, value))

    def _keep(self, address: int, value: float) -> None:
        if any(address in addresses for addresses in CONFIGURATION):
            self._refuse_while_streaming()
        if (address - RANGE) / 2 in AINS:
            wide_enough = [range_v for range_v in labjack.RANGES_V if value and range_v >= value * (1.0 - 1e-6)]
            value = min(wide_enough, default=labjack.RANGES_V[0])
        if (address - EF_INDEX) / 2 in DIOS and self._settings[address - EF_INDEX + EF_ENABLE]:
            raise self._refusal(NO_CODE)
        self._settings[address] = value

    def _all_inputs(self, address: int, first: int) -> Register:
        """Return a register that sets all analog inputs at once."""
        (row,) = (row for row in labjack.KEPT if row.address == first)
        places = [place for place, _, _ in labjack.each([row])]

        def read() -> float:
            found = {self._settings[place] for place in places}
            return found.pop() if len(found) == 1 else labjack.MIXED[row.kind]

        def write(value: float) -> None:
            for place in places:
                self._keep(place, value)

        return KINDS[row.kind](address, read, write)

    def _at_rest(self, reading: Callable[..., Number], *arguments: int, **more: bool) -> Number:
        self._refuse_while_streaming()
        return reading(*arguments, **more)

    def _enable(self, value: int) -> None:
        if not value:
            if not self._stream.running:
                raise self._refusal(NOT_RUNNING)
            self._stream.end()
            return
        self._refuse_while_streaming()
        self._check_settings()
        scan_list = self._scan_list()
        rate_hz = scan_rate(self._settings[RATE])
        first_s = self._inputs.now()
        self._started = self._core_timer(first_s)
        self._stream.begin(
            StreamBuffer(
                StreamSettings(
                    first_s=first_s,
                    rate_hz=rate_hz,
                    scan_length=len(scan_list),
                    samples_per_packet=int(self._settings[PACKET]),
                    buffer_bytes=int(self._settings[BUFFER]) or DEFAULT_BUFFER_BYTES,
                    sample=lambda start, scans: self._terminals.scans(
                        scan_list, first_s, 1.0 / rate_hz, scans, start=start
                    ),
                )
            )
        )

    def _check_settings(self) -> None:
        settings = self._settings
        rate_hz, buffer_bytes = settings[RATE], int(settings[BUFFER])
        right = {
            LIST_INVALID: settings[LENGTH] <= labjack.SCAN_LIST_LENGTH
            and self._terminals.can_stream(self._scan_list()),
            RATE_INVALID: math.isfinite(rate_hz) and rate_hz > 0.0,
            PACKET_INVALID: 1 <= settings[PACKET] <= MOST_SAMPLES,
            BUFFER_INVALID: buffer_bytes <= LARGEST_BUFFER_BYTES and not buffer_bytes & (buffer_bytes - 1),
            TARGET_INVALID: settings[TARGET] == ETHERNET,
            NO_CODE: settings[DATATYPE] == 0 and settings[BURST] == 0,
        }
        for code, holds in right.items():
            if not holds:
                raise self._refusal(code)

    def _scan_list(self) -> list[int]:
        return [int(self._settings[SCAN_LIST + 2 * place]) for place in range(int(self._settings[LENGTH]))]

    def _refuse_while_streaming(self) -> None:
        if self._stream.running:
            raise self._refusal(STREAM_RUNS)

    def _refusal(self, code: int) -> ModbusRefusal:
        self._last_error = code
        return ModbusRefusal(DEVICE_FAILURE)

    def _core_timer(self, bench_time_s: float) -> int:
        return (CORE_AT_START + math.floor(bench_time_s * CORE_HZ)) & 0xFFFFFFFF


def scan_rate(rate_hz: float) -> float:
    """Return the scan rate [Hz] that a T7 uses if `rate_hz` is requested; an invalid rate is returned unchanged."""
    if not 0.0 < rate_hz < math.inf:
        return rate_hz
    count, steps = SCAN_CLOCK_HZ / rate_hz, 1
    while count / steps > LONGEST_COUNT:
        steps *= 2
    return SCAN_CLOCK_HZ / (max(1, round(count / steps)) * steps)


def _write_only() -> int:
    raise ModbusRefusal(ILLEGAL_ADDRESS)


Twin = SimulatedLabJackT7
