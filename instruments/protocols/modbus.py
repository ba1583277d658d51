"""The server's side of Modbus: parses requests from a stream of bytes and creates replies; no link, no registers.

    TCP  | transaction 2 | protocol = 0, 2 | length 2 | unit 1 | function 1 | data ... |
    RTU                                               | unit 1 | function 1 | data ... | CRC-16, low byte first |

    3, 4 read registers    address 2, count 2                      -> byte count 1, values 2 each
    6 write one            address 2, value 2                      -> the same again
    16 write several       address 2, count 2, byte count 1, values -> address 2, count 2
    refusal                                                        -> function + 80h, exception code 1

Numbers are big-endian. Source: MODBUS Application Protocol 1.1b3 chapters 6 and 7, MODBUS over Serial Line 1.02 chapter
2.5.

Assumption: one master, which may send further requests before the first is answered; they are returned in order. An RTU
line has no delimiter but silence, which a stream of bytes does not show: a frame is found by its length and its CRC.

Accepted input: frames split or joined anywhere; on RTU noise before and between frames and a damaged frame (not
answered, as on the line). On TCP an invalid header means that the stream is lost: the received bytes are dropped.

Numbers in 16-bit registers: Modbus does not define the meaning of its 16-bit registers. The word order of a 32-bit
number depends on the device (LabJack: high first; Watlow F4T as delivered: low first) and is the most frequent cause of
readings like 1e-12 or 1e34.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, cast

WordOrder = Literal["high_first", "low_first"]


def signed_from_word(word: int) -> int:
    """Return -32768 ... 32767 from a word in two's complement."""
    return word - 0x10000 if word > 0x7FFF else word


def word_from_signed(value: int) -> int:
    """Return a word in two's complement; raises `ValueError` outside -32768 ... 32767."""
    if not -0x8000 <= value <= 0x7FFF:
        raise ValueError(f"{value} does not fit into a signed 16-bit register")
    return value & 0xFFFF


def f32_from_words(words: Sequence[int], word_order: WordOrder) -> float:
    """Return an IEEE 754 single from two words."""
    return cast(float, struct.unpack(">f", _bytes(words, word_order))[0])


def words_from_f32(value: float, word_order: WordOrder) -> list[int]:
    """Return the two words of an IEEE 754 single; raises `OverflowError` if the value is too large."""
    return _words(struct.pack(">f", value), word_order)


def u32_from_words(words: Sequence[int], word_order: WordOrder) -> int:
    """Return an unsigned 32-bit number from two words."""
    return int.from_bytes(_bytes(words, word_order), "big")


def words_from_u32(value: int, word_order: WordOrder) -> list[int]:
    """Return the two words of an unsigned 32-bit number; raises `OverflowError` if it does not fit."""
    return _words(value.to_bytes(4, "big"), word_order)


def _bytes(words: Sequence[int], word_order: WordOrder) -> bytes:
    first, second = words
    return struct.pack(">HH", first, second) if word_order == "high_first" else struct.pack(">HH", second, first)


def _words(data: bytes, word_order: WordOrder) -> list[int]:
    high, low = struct.unpack(">HH", data)
    return [high, low] if word_order == "high_first" else [low, high]


READ_HOLDING, READ_INPUT, WRITE_ONE, WRITE_SEVERAL = 3, 4, 6, 16
READS = (READ_HOLDING, READ_INPUT)

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE = 1, 2, 3, 4
EXCEPTION_WORDS = {
    ILLEGAL_FUNCTION: "illegal function",
    ILLEGAL_ADDRESS: "illegal data address",
    ILLEGAL_VALUE: "illegal data value",
    DEVICE_FAILURE: "device failure",
    5: "acknowledged, still busy with it, or write denied",
    6: "device busy",
    8: "memory parity error, or write denied",
    10: "gateway path unavailable",
    11: "no device behind the gateway answers",
}

MOST_READ, MOST_WRITTEN = 125, 123  # registers per request
LONGEST_RTU_FRAME = 256

RTU_FIXED_LENGTH = dict.fromkeys((1, 2, 3, 4, 5, 6, 8), 8) | dict.fromkeys((7, 11, 12, 17), 4) | {22: 10, 24: 6}
RTU_COUNT_AT = {15: 6, 16: 6, 20: 2, 21: 2, 23: 10}  # index of the byte that counts the following bytes
RTU_HEAD, RTU_CRC = 11, 2  # the longest head that determines a frame's length
MBAP = struct.Struct(">HHHB")


class ModbusRefusal(Exception):  # noqa: N818 - not an error of the program, but a device's answer
    """A register map refuses a request; `code` is the exception code of the reply."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(exception_words(code))


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """A master's request to a unit.

    `values` are the words to write; `count` the number of registers. `data` is the data after any other function code
    than these four. `fault` is the exception code for an invalid form of the request, or 0. `transaction` is TCP's, to
    be repeated in the reply.
    """

    unit: int
    function: int
    address: int = 0
    count: int = 0
    values: tuple[int, ...] = ()
    data: bytes = b""
    fault: int = 0
    transaction: int = 0


class ServerFraming(Protocol):
    """The framing of one connection, TCP or RTU."""

    def feed(self, data: bytes) -> list[Request]:
        """Add received bytes and return the requests that they complete, in order."""

    def reply(self, request: Request, values: Sequence[int] = ()) -> bytes:
        """Return the reply to a successful request; `values` are the words read, or bytes of another function."""

    def refuse(self, request: Request, code: int) -> bytes:
        """Return the reply to a refused request."""


class TcpFraming:
    """Modbus TCP, the server's side of one connection."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Request]:
        """Add received bytes and return the requests that they complete, in order."""
        self._buffer += data
        requests = []
        while len(self._buffer) >= MBAP.size:
            transaction, protocol, length, unit = MBAP.unpack_from(self._buffer)
            if protocol != 0 or not 2 <= length <= LONGEST_RTU_FRAME - RTU_CRC:
                self._buffer.clear()
                break
            end = MBAP.size - 1 + length
            if len(self._buffer) < end:
                break
            requests.append(parse_request(unit, bytes(self._buffer[MBAP.size : end]), transaction))
            del self._buffer[:end]
        return requests

    def reply(self, request: Request, values: Sequence[int] = ()) -> bytes:
        """Return the reply to a successful request; `values` are the words read."""
        return self._frame(request, reply_pdu(request, values))

    def refuse(self, request: Request, code: int) -> bytes:
        """Return the reply to a refused request."""
        return self._frame(request, refusal_pdu(request, code))

    def _frame(self, request: Request, pdu: bytes) -> bytes:
        return MBAP.pack(request.transaction, 0, 1 + len(pdu), request.unit) + pdu


class RtuFraming:
    """Modbus RTU, the server's side of a line."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Request]:
        """Add received bytes and return the requests that they complete, in order.

        A complete frame is accepted anywhere, even after the possible beginning of another one: noise that looks like
        the head of a long write must not swallow the requests after it.
        """
        self._buffer += data
        requests = []
        while found := self._first_frame():
            start, end = found
            requests.append(parse_request(self._buffer[start], bytes(self._buffer[start + 1 : end - RTU_CRC])))
            del self._buffer[:end]
        del self._buffer[:-LONGEST_RTU_FRAME]
        return requests

    def reply(self, request: Request, values: Sequence[int] = ()) -> bytes:
        """Return the reply to a successful request; `values` are the words read."""
        return with_crc(bytes([request.unit]) + reply_pdu(request, values))

    def refuse(self, request: Request, code: int) -> bytes:
        """Return the reply to a refused request."""
        return with_crc(bytes([request.unit]) + refusal_pdu(request, code))

    def _first_frame(self) -> tuple[int, int] | None:
        for start in range(len(self._buffer)):
            length = rtu_length(self._buffer[start : start + RTU_HEAD])
            end = start + length
            if length and end <= len(self._buffer) and crc16(self._buffer[start:end]) == 0:
                return start, end
        return None


def rtu_length(head: bytes | bytearray) -> int:
    """Return the length in bytes of the RTU request with this head; 0 if it is not yet known or not a request."""
    if len(head) < 2:
        return 0
    function = head[1]
    count_at = RTU_COUNT_AT.get(function, 0)
    if not count_at:
        return RTU_FIXED_LENGTH.get(function, 0)
    if len(head) <= count_at:
        return 0
    length = count_at + 1 + head[count_at] + RTU_CRC
    return length if length <= LONGEST_RTU_FRAME else 0


def parse_request(unit: int, pdu: bytes, transaction: int = 0) -> Request:
    """Parse a protocol data unit: function code and data; an invalid form is reported in `fault`."""
    function = pdu[0]
    if function in READS and len(pdu) == 5:
        address, count = struct.unpack_from(">HH", pdu, 1)
        fault = 0 if 1 <= count <= MOST_READ else ILLEGAL_VALUE
        values: tuple[int, ...] = ()
    elif function == WRITE_ONE and len(pdu) == 5:
        address, value = struct.unpack_from(">HH", pdu, 1)
        count, values, fault = 1, (value,), 0
    elif function == WRITE_SEVERAL and len(pdu) >= 6:
        address, count, size = struct.unpack_from(">HHB", pdu, 1)
        sound = 1 <= count <= MOST_WRITTEN and size == 2 * count == len(pdu) - 6
        values = struct.unpack_from(f">{count}H", pdu, 6) if sound else ()
        fault = 0 if sound else ILLEGAL_VALUE
    else:
        known = function in (*READS, WRITE_ONE, WRITE_SEVERAL)
        return Request(
            unit=unit,
            function=function,
            data=pdu[1:],
            fault=ILLEGAL_VALUE if known else ILLEGAL_FUNCTION,
            transaction=transaction,
        )
    if not fault and address + count > 0x10000:
        fault = ILLEGAL_ADDRESS
    return Request(
        unit=unit,
        function=function,
        address=address,
        count=count,
        values=values,
        fault=fault,
        transaction=transaction,
    )


def reply_pdu(request: Request, values: Sequence[int]) -> bytes:
    """Return function code and data of the reply to a successful request."""
    if isinstance(values, bytes):
        return bytes([request.function]) + values
    if request.function in READS:
        return struct.pack(f">BB{len(values)}H", request.function, 2 * len(values), *values)
    if request.function == WRITE_ONE:
        return struct.pack(">BHH", request.function, request.address, request.values[0])
    return struct.pack(">BHH", request.function, request.address, request.count)


def refusal_pdu(request: Request, code: int) -> bytes:
    """Return function code and exception code of a refusal."""
    return bytes([request.function | 0x80, code])


def exception_words(code: int) -> str:
    """Return an exception code with its meaning."""
    return f"exception {code} ({EXCEPTION_WORDS.get(code, 'not in the standard')})"


def crc16(data: bytes | bytearray) -> int:
    """Return the CRC-16/MODBUS (polynomial 8005h reflected, start FFFFh); 0 over a valid frame including its CRC."""
    crc = 0xFFFF
    for byte in data:
        crc = (crc >> 8) ^ CRC_TABLE[(crc ^ byte) & 0xFF]
    return crc


def with_crc(frame: bytes) -> bytes:
    """Return a frame followed by its CRC, low byte first."""
    return frame + crc16(frame).to_bytes(2, "little")


def _crc_of_byte(byte: int) -> int:
    for _ in range(8):
        byte = (byte >> 1) ^ 0xA001 if byte & 1 else byte >> 1
    return byte


CRC_TABLE = tuple(_crc_of_byte(byte) for byte in range(256))
