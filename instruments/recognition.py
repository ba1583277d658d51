"""How a driver recognises its instrument: declared by the driver itself, used by `probe` on an unknown device.

A driver's class has the attribute `recognition`, a tuple of declarations, in this or in another package:

| declaration   | the device                     | receives                                                        |
|---------------|--------------------------------|-----------------------------------------------------------------|
| `ByFrames`    | sends frames unasked           | nothing                                                         |
| `ByLine`      | answers lines of ASCII         | `*IDN?`, as every such device, then the declared query          |
| `ByRegisters` | answers Modbus                 | reads of registers; a write raises an error                     |

A query must change nothing: no motion, no setting, no queue of errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

from benchctl_instruments.interfaces import Clock
from benchctl_instruments.links.modbus import ModbusLink

Certainty = Literal["certain", "likely", "possible"]
"""`certain`: it states its name or an identification constant. `likely`: its answer has the form that this driver
expects, which few others have. `possible`: its registers hold values that make sense to this driver."""
CERTAINTIES: tuple[Certainty, ...] = get_args(Certainty)
"""The best first."""

Scheme = Literal["tcp", "serial", "socket"]
ANY_LINK: tuple[Scheme, ...] = get_args(Scheme)


@dataclass(frozen=True, slots=True, kw_only=True)
class ByFrames:
    """Recognised by frames that it sends unasked, at `baud`; `find` describes those in some bytes, or returns ""."""

    baud: int
    find: Callable[[bytes], str]
    certainty: Certainty = "likely"


@dataclass(frozen=True, slots=True, kw_only=True)
class ByLine:
    """Recognised by a line of ASCII.

    `names` are parts of an answer to `*IDN?` that are certain, in capitals. `read` describes the device from the answer
    to `query`, or raises `InstrumentError` if that is another device's. `sent_end`, `answer_end` and `encoding` are
    those of `Manners`; `baud` is the speed of a serial address that states none.
    """

    query: str
    read: Callable[[str], str]
    names: tuple[str, ...] = ()
    sent_end: bytes = b"\r\n"
    answer_end: bytes | None = b"\n"
    encoding: str = "ascii"
    baud: int = 19200
    schemes: tuple[Scheme, ...] = ANY_LINK


@dataclass(frozen=True, slots=True, kw_only=True)
class ByRegisters:
    """Recognised by the registers of a Modbus unit.

    `read` reads them over a link and describes the device, or raises `InstrumentError` if they are another device's.
    `pause_s` is the quiet time that the device needs between two requests.
    """

    read: Callable[[ModbusLink, Clock], str]
    certainty: Certainty
    baud: int = 19200
    pause_s: float = 0.0
    schemes: tuple[Scheme, ...] = ANY_LINK
