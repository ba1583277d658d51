"""What a fault has to know of the protocol on a wire: how a request reads, and how its answer can be wrong in form.

| wire         | a request reads as                    | unit | checksum | refusal               | words |
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
    """A protocol as faults see it; what it cannot do is None."""

    @property
    def other_unit(self) -> Callable[[bytes], bytes] | None:
        """The answer as another unit would give it."""

    @property
    def bad_checksum(self) -> Callable[[bytes], bytes] | None:
        """The answer with a checksum that is wrong."""

    @property
    def half_float(self) -> Callable[[bytes], bytes] | None:
        """The answer without its last register, sound otherwise; as it is where it holds no registers."""

    @property
    def refusal(self) -> Callable[[bytes, int], bytes] | None:
        """What answers a request (first) that is refused with a code."""

    def requests(self, data: bytes) -> list[bytes]:
        """What has arrived at once, taken apart into requests."""

    def shown(self, request: bytes) -> str:
        """How a request reads."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lines:
    """Lines of ASCII; `refusal_line` is how the instrument says no, whatever the code."""

    refusal_line: bytes = b""

    other_unit = None
    bad_checksum = None
    half_float = None

    @property
    def refusal(self) -> Callable[[bytes, int], bytes] | None:
        """What answers a request that is refused."""
        return (lambda request, code: self.refusal_line) if self.refusal_line else None

    def requests(self, data: bytes) -> list[bytes]:
        """Its lines, each with its end."""
        return LINE.findall(data)

    def shown(self, request: bytes) -> str:
        """Its text, without the line's end."""
        return request.decode("ascii", "backslashreplace").strip()[:MOST_SHOWN]


class ModbusTcp:
    """Modbus TCP; a transaction number, and no checksum of its own."""

    bad_checksum = None

    def requests(self, data: bytes) -> list[bytes]:
        """One, as masters that wait for answers send it."""
        return [data]

    def shown(self, request: bytes) -> str:
        """Function and data in hex."""
        return request[MBAP.size :].hex(" ")[:MOST_SHOWN]

    def other_unit(self, answer: bytes) -> bytes:
        """The answer of the unit with the next number."""
        return answer[: MBAP.size - 1] + bytes([answer[MBAP.size - 1] % 247 + 1]) + answer[MBAP.size :]

    def half_float(self, answer: bytes) -> bytes:
        """The answer to a read without its last register."""
        pdu = _without_last_register(answer[MBAP.size :])
        transaction, protocol, _, unit = MBAP.unpack_from(answer)
        return MBAP.pack(transaction, protocol, 1 + len(pdu), unit) + pdu

    def refusal(self, request: bytes, code: int) -> bytes:
        """An exception."""
        transaction, _, _, unit = MBAP.unpack_from(request)
        return MBAP.pack(transaction, 0, 3, unit) + struct.pack("BB", request[MBAP.size] | 0x80, code)


class ModbusRtu:
    """Modbus RTU; a unit's number, a CRC, and nothing that tells one request from the next."""

    def requests(self, data: bytes) -> list[bytes]:
        """One, as masters that wait for answers send it."""
        return [data]

    def shown(self, request: bytes) -> str:
        """Function and data in hex."""
        return request[1:-RTU_CRC].hex(" ")[:MOST_SHOWN]

    def other_unit(self, answer: bytes) -> bytes:
        """The answer of the unit with the next number."""
        return with_crc(bytes([answer[0] % 247 + 1]) + answer[1:-RTU_CRC])

    def bad_checksum(self, answer: bytes) -> bytes:
        """One bit of the CRC the other way round."""
        return answer[:-1] + bytes([answer[-1] ^ 0x10])

    def half_float(self, answer: bytes) -> bytes:
        """The answer to a read without its last register."""
        return with_crc(answer[:1] + _without_last_register(answer[1:-RTU_CRC]))

    def refusal(self, request: bytes, code: int) -> bytes:
        """An exception."""
        return with_crc(bytes([request[0], request[1] | 0x80, code]))


def _without_last_register(pdu: bytes) -> bytes:
    if pdu[0] not in READS:
        return pdu
    return bytes([pdu[0], pdu[1] - 2]) + pdu[2:-2]


MODBUS_TCP, MODBUS_RTU = ModbusTcp(), ModbusRtu()
