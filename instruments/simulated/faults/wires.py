"""What a fault needs of a wire's protocol: the text of a request, and the ways in which an answer can be corrupted.

| wire         | the text of a request                 | unit | checksum | refusal               | words |
|--------------|---------------------------------------|------|----------|-----------------------|-------|
| `MODBUS_TCP` | its function and data in hex, blanks  | yes  | no       | exception code        | yes   |
| `MODBUS_RTU` | between: `03 00 64 00 01`             | yes  | yes      | exception code        | yes   |
| `Lines`      | its text, without the line's end      | no   | no       | the line it is given  | no    |
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from benchctl_instruments.protocols.modbus import MBAP, READS, RTU_CRC, with_crc

MOST_SHOWN = 200  # characters of a request
LINE = re.compile(rb"[^\r\n]*[\r\n]+|[^\r\n]+$")


class Wire(Protocol):
    """A protocol as used by faults; unsupported functions are None."""

    @property
    def other_unit(self) -> Callable[[bytes], bytes] | None:
        """Function that changes an answer to that of another unit."""

    @property
    def bad_checksum(self) -> Callable[[bytes], bytes] | None:
        """Function that gives an answer a wrong checksum."""

    @property
    def half_float(self) -> Callable[[bytes], bytes] | None:
        """Function that removes an answer's last register; an answer without registers is unchanged."""

    @property
    def refusal(self) -> Callable[[bytes, int], bytes] | None:
        """Function that returns the refusal of a request (first argument) with a code."""

    def requests(self, data: bytes) -> list[bytes]:
        """Split bytes that arrived together into requests."""

    def shown(self, request: bytes) -> str:
        """Return the text of a request."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lines:
    """Lines of ASCII; `refusal_line` is the instrument's refusal for any code."""

    refusal_line: bytes = b""

    other_unit = None
    bad_checksum = None
    half_float = None

    @property
    def refusal(self) -> Callable[[bytes, int], bytes] | None:
        """Function that returns the refusal of a request."""
        return (lambda request, code: self.refusal_line) if self.refusal_line else None

    def requests(self, data: bytes) -> list[bytes]:
        """Return its lines, each with its end."""
        return LINE.findall(data)

    def shown(self, request: bytes) -> str:
        """Return its text, without the line's end."""
        return request.decode("ascii", "backslashreplace").strip()[:MOST_SHOWN]


class _Modbus:
    def requests(self, data: bytes) -> list[bytes]:
        """Return one request, as masters that wait for answers send it."""
        return [data]


class ModbusTcp(_Modbus):
    """Modbus TCP: a transaction number, and no checksum."""

    bad_checksum = None

    def shown(self, request: bytes) -> str:
        """Return function and data in hex."""
        return request[MBAP.size :].hex(" ")[:MOST_SHOWN]

    def other_unit(self, answer: bytes) -> bytes:
        """Return the answer as that of the unit with the next number."""
        return answer[: MBAP.size - 1] + bytes([answer[MBAP.size - 1] % 247 + 1]) + answer[MBAP.size :]

    def half_float(self, answer: bytes) -> bytes:
        """Return the answer to a read without its last register."""
        pdu = _without_last_register(answer[MBAP.size :])
        transaction, protocol, _, unit = MBAP.unpack_from(answer)
        return MBAP.pack(transaction, protocol, 1 + len(pdu), unit) + pdu

    def refusal(self, request: bytes, code: int) -> bytes:
        """Return an exception."""
        transaction, _, _, unit = MBAP.unpack_from(request)
        return MBAP.pack(transaction, 0, 3, unit) + struct.pack("BB", request[MBAP.size] | 0x80, code)


class ModbusRtu(_Modbus):
    """Modbus RTU: a unit number, a CRC, and no transaction number."""

    def shown(self, request: bytes) -> str:
        """Return function and data in hex."""
        return request[1:-RTU_CRC].hex(" ")[:MOST_SHOWN]

    def other_unit(self, answer: bytes) -> bytes:
        """Return the answer as that of the unit with the next number."""
        return with_crc(bytes([answer[0] % 247 + 1]) + answer[1:-RTU_CRC])

    def bad_checksum(self, answer: bytes) -> bytes:
        """Return the answer with one bit of the CRC inverted."""
        return answer[:-1] + bytes([answer[-1] ^ 0x10])

    def half_float(self, answer: bytes) -> bytes:
        """Return the answer to a read without its last register."""
        return with_crc(answer[:1] + _without_last_register(answer[1:-RTU_CRC]))

    def refusal(self, request: bytes, code: int) -> bytes:
        """Return an exception."""
        return with_crc(bytes([request[0], request[1] | 0x80, code]))


def _without_last_register(pdu: bytes) -> bytes:
    if pdu[0] not in READS:
        return pdu
    return bytes([pdu[0], pdu[1] - 2]) + pdu[2:-2]


MODBUS_TCP, MODBUS_RTU = ModbusTcp(), ModbusRtu()
