"""A simulated LabJack T7: its registers on Modbus TCP and its spontaneous stream on a socket of its own.

Only what a driver of this bench uses is there, as strict as the T7 or stricter: inputs are not read singly, and nothing
is configured, while a stream runs; that is refused with error 2605. The scan rate is the nearest whose interval is a
whole number of ticks of the 40 MHz clock, rounded to the single that its register states.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Self, TypeVar

from instruments.errors import UsageError
from instruments.protocols.modbus import DEVICE_FAILURE, ModbusRefusal
from instruments.protocols.t7_stream import MOST_SAMPLES
from instruments.simulated.faults.link_faults import LinkFaults
from instruments.simulated.faults.stream_faults import StreamFaults
from instruments.simulated.faults.wires import MODBUS_TCP, Wire
from instruments.simulated.machines import AnalogInputs
from instruments.simulated.modbus_server import ModbusTcpServer
from instruments.simulated.registers import Register, RegisterTable, f32, u32, word
from instruments.simulated.t7_stream_buffer import StreamBuffer, StreamSettings
from instruments.simulated.t7_stream_server import T7StreamServer
from instruments.simulated.t7_terminals import ANALOG_INPUTS, DIGITAL_LINES, RANGES_V, DigitalLine, T7Terminals

Number = TypeVar("Number", int, float)

CORE_HZ = 40_000_000
CORE_AT_START = 0xF000_0000  # it has been on for a while, and wraps soon
LONGEST_SCAN_LIST = 128
DEFAULT_BUFFER_BYTES, LARGEST_BUFFER_BYTES = 4096, 32768
ETHERNET = 1

STREAM_RUNS, LIST_INVALID, RATE_INVALID, TARGET_INVALID = 2605, 2607, 2608, 2612
BUFFER_INVALID, PACKET_INVALID, NOT_RUNNING = 2615, 2618, 2620
NO_CODE = 0  # refused, but LabJack's code for it is not known here

RATE, LENGTH, PACKET, BUFFER, TARGET, DATATYPE, BURST = 4002, 4004, 4006, 4012, 4016, 4018, 4020
SCAN_LIST = 4100
AS_DELIVERED = {DATATYPE: 1, TARGET: 16}


class SimulatedLabJackT7:
    """A T7 at `address` and `stream_address`, from `start()` to `stop()`, or in a `with`.

    Parameters
    ----------
    inputs
        What its terminals see.
    encoder_channel, gyro_ain, thermistor_ain
        What is wired to which terminals, as in `T7Terminals`.
    serial
        Its serial number.
    host, port, stream_port
        Where its registers and its stream are; port 0 takes a free one.
    """

    wire: Wire = MODBUS_TCP

    def __init__(
        self,
        inputs: AnalogInputs,
        *,
        encoder_channel: int = 0,
        gyro_ain: int = 0,
        thermistor_ain: int = 1,
        serial: int = 470_012_345,
        host: str = "127.0.0.1",
        port: int = 0,
        stream_port: int = 0,
    ) -> None:
        self._inputs = inputs
        self._serial = serial
        self._terminals = T7Terminals(
            inputs, encoder_channel=encoder_channel, gyro_ain=gyro_ain, thermistor_ain=thermistor_ain
        )
        self._last_error = 0
        self._settings: dict[int, float] = dict(AS_DELIVERED)
        self._flash_pointer = 0
        self._started = (0, 0.0)  # CORE_TIMER at the first scan, actual rate
        self._stream = T7StreamServer(inputs, host=host, port=stream_port)
        self._modbus = ModbusTcpServer(RegisterTable(self._registers()), unit_id=None, host=host, port=port)

    @property
    def address(self) -> str:
        """`tcp://HOST:PORT` of its registers."""
        return self._modbus.address

    @property
    def stream_address(self) -> str:
        """`tcp://HOST:PORT` of its stream."""
        return self._stream.address

    @property
    def faults(self) -> LinkFaults | None:
        """What befalls the requests for its registers; to be set before the start."""
        return self._modbus.faults

    @faults.setter
    def faults(self, faults: LinkFaults | None) -> None:
        self._modbus.faults = faults

    @property
    def stream_faults(self) -> StreamFaults | None:
        """What befalls the packets of its stream; to be set before the start."""
        return self._stream.faults

    @stream_faults.setter
    def stream_faults(self, faults: StreamFaults | None) -> None:
        self._stream.faults = faults

    def restart(self) -> None:
        """Start anew, as after a power failure: no stream, every setting as delivered, encoder lines at rest."""
        self._stream.end()
        self._settings.clear()
        self._settings |= AS_DELIVERED
        self._terminals.restart()

    def start(self) -> None:
        """Serve; when it returns, a driver can connect."""
        self._stream.start()
        try:
            self._modbus.start()
        except UsageError:  # its port is taken
            self._stream.stop()
            raise

    def stop(self) -> None:
        """Close everything; safe to call twice."""
        self._modbus.stop()
        self._stream.stop()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self.stop()

    def _registers(self) -> list[Register]:
        return [
            u32(55000, lambda: self._last_error),
            u32(55100, lambda: 0x00112233),
            f32(55124, lambda: -9999.0),
            f32(60000, lambda: 7.0),
            f32(60004, lambda: 1.0292),
            u32(60028, lambda: self._serial),
            u32(61520, lambda: self._core_timer(self._inputs.now())),
            u32(61810, lambda: self._flash_pointer, lambda value: setattr(self, "_flash_pointer", value)),
            Register(address=61812, words=8, read=lambda: self._terminals.flash(self._flash_pointer)),
            *(self._setting(f32, address) for address in (RATE, 4008)),
            *(self._setting(u32, address) for address in (LENGTH, PACKET, 4010, BUFFER, 4014, TARGET, DATATYPE, BURST)),
            self._setting(u32, 4024),
            u32(4026, lambda: self._started[0]),
            *(self._setting(u32, SCAN_LIST + 2 * place) for place in range(LONGEST_SCAN_LIST)),
            f32(4494, lambda: self._started[1]),
            u32(4990, lambda: int(self._stream.running), self._enable),
            *(register for channel in range(ANALOG_INPUTS) for register in self._analog(channel)),
            *(register for line in range(DIGITAL_LINES) for register in self._digital(line)),
        ]

    def _setting(self, kind: Callable[..., Register], address: int) -> Register:
        """A number that is kept as it is written, while no stream runs."""
        return kind(address, lambda: self._settings.get(address, 0), lambda value: self._keep(address, value))

    def _keep(self, address: int, value: float) -> None:
        self._refuse_while_streaming()
        self._settings[address] = value

    def _analog(self, channel: int) -> list[Register]:
        ranges = self._terminals.range_v
        return [
            f32(2 * channel, lambda: self._at_rest(lambda: self._terminals.single_volts(channel))),
            f32(40000 + 2 * channel, lambda: ranges[channel], lambda value: self._set_range(channel, value)),
            self._setting(word, 41000 + channel),
            self._setting(word, 41500 + channel),
            self._setting(f32, 42000 + 2 * channel),
        ]

    def _digital(self, number: int) -> list[Register]:
        line = self._terminals.lines[number]
        return [
            u32(3000 + 2 * number, lambda: self._at_rest(lambda: self._terminals.count(number))),
            u32(44000 + 2 * number, lambda: line.enabled, lambda value: setattr(line, "enabled", value)),
            u32(44100 + 2 * number, lambda: line.index, lambda value: self._set_feature(line, value)),
            u32(44200 + 2 * number, lambda: line.options, lambda value: setattr(line, "options", value)),
        ]

    def _at_rest(self, reading: Callable[[], Number]) -> Number:
        self._refuse_while_streaming()
        return reading()

    def _set_range(self, channel: int, value: float) -> None:
        """The smallest range that holds what was asked for; 0 means the largest."""
        self._refuse_while_streaming()
        wide_enough = [range_v for range_v in RANGES_V if value and range_v >= value * (1.0 - 1e-6)]
        self._terminals.range_v[channel] = min(wide_enough, default=RANGES_V[0])

    def _set_feature(self, line: DigitalLine, index: int) -> None:
        if line.enabled:
            raise self._refusal(NO_CODE)
        line.index = index

    def _enable(self, value: int) -> None:
        if not value:
            if not self._stream.running:
                raise self._refusal(NOT_RUNNING)
            self._stream.end()
            return
        self._refuse_while_streaming()
        self._check_settings()
        scan_list = self._scan_list()
        rate_hz = _single(CORE_HZ / max(1, round(CORE_HZ / self._settings[RATE])))
        first_s = self._inputs.now()
        self._started = (self._core_timer(first_s), rate_hz)
        self._stream.begin(
            StreamBuffer(
                StreamSettings(
                    first_s=first_s,
                    rate_hz=rate_hz,
                    scan_length=len(scan_list),
                    samples_per_packet=int(self._settings[PACKET]),
                    buffer_bytes=int(self._settings.get(BUFFER, 0)) or DEFAULT_BUFFER_BYTES,
                    sample=lambda start, scans: self._terminals.scans(
                        scan_list, first_s, 1.0 / rate_hz, scans, start=start
                    ),
                )
            )
        )

    def _check_settings(self) -> None:
        settings = self._settings
        rate_hz, buffer_bytes = settings.get(RATE, 0.0), int(settings.get(BUFFER, 0))
        right = {
            LIST_INVALID: settings.get(LENGTH, 0) <= LONGEST_SCAN_LIST
            and self._terminals.can_stream(self._scan_list()),
            RATE_INVALID: math.isfinite(rate_hz) and rate_hz > 0.0,
            PACKET_INVALID: 1 <= settings.get(PACKET, 0) <= MOST_SAMPLES,
            BUFFER_INVALID: buffer_bytes <= LARGEST_BUFFER_BYTES and not buffer_bytes & (buffer_bytes - 1),
            TARGET_INVALID: settings[TARGET] == ETHERNET,
            NO_CODE: settings[DATATYPE] == 0 and settings.get(BURST, 0) == 0,
        }
        for code, holds in right.items():
            if not holds:
                raise self._refusal(code)

    def _scan_list(self) -> list[int]:
        length = int(self._settings.get(LENGTH, 0))
        return [int(self._settings.get(SCAN_LIST + 2 * place, 0)) for place in range(length)]

    def _refuse_while_streaming(self) -> None:
        if self._stream.running:
            raise self._refusal(STREAM_RUNS)

    def _refusal(self, code: int) -> ModbusRefusal:
        self._last_error = code
        return ModbusRefusal(DEVICE_FAILURE)

    def _core_timer(self, bench_time_s: float) -> int:
        return (CORE_AT_START + math.floor(bench_time_s * CORE_HZ)) & 0xFFFFFFFF


def _single(value: float) -> float:
    """The nearest IEEE 754 single."""
    return float(struct.unpack(">f", struct.pack(">f", value))[0])


Twin = SimulatedLabJackT7
