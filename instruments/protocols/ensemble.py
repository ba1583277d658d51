r"""The ASCII interface of Aerotech's Ensemble over TCP port 8000. Converts lines and replies; no I/O.

Source: openly published driver code (epics-motor/motorAerotech drvEnsembleAsyn.cc; robmarkcole/aerotech; ESRF's bliss;
lab-control-lib; EnsembleSocketConnection.py), and the numbers of bits and parameters from the manufacturer's published
headers (EnsembleCommonStructures.h, EnsembleParameterId.h). Not tried on hardware.

A command is a line of ASCII in the controller's own language, and every line is answered with a line::

    FREERUN @0 50.000000 LF            axis 0 turns at 50 units/s, until ABORT @0
    RAMP RATE @0 500.000000 LF         its acceleration
    MOVEABS X10.0 XF5.0 Y3 YF5 LF      axes 0 and 1 move, each at its own speed; F5 without an axis applies to all
    AXISSTATUS(@0) LF                  a query; AXISSTATUS @0 means the same

    %-2147483641 LF                    reply: one character, then data if there are any
    \_________/
     |  data
     % done   ! not understood   # refused, or a fault   $ not done in time

The four characters are those of a controller as delivered; they are parameters of it. Words are case-insensitive, an
axis is `@` and its number or its name. Numbers of 32 bits are written as signed ones: a status is usually negative,
since its highest bit is the emergency stop's input.

Assumption without a source: the data of `!`, `#` and `$`, if there are any, describe the fault.

Accepted input: a bare `%` line, once or several times, before the reply to a query. Other disturbances of lines are
handled in `benchctl_instruments.protocols.lines`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, IntFlag

from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.protocols.lines import MOST_SHOWN

END = b"\n"


class Outcome(Enum):
    """The meaning of a reply's first character."""

    DONE = "%"
    NOT_UNDERSTOOD = "!"
    REFUSED = "#"
    NOT_IN_TIME = "$"


class AxisStatus(IntFlag):
    """The bits of AXISSTATUS used here; `EMERGENCY_STOP_INPUT` is the level of that input."""

    ENABLED = 1 << 0
    HOMED = 1 << 1
    IN_POSITION = 1 << 2
    MOVE_ACTIVE = 1 << 3
    COUNTER_CLOCKWISE = 1 << 9
    HOMING = 1 << 14
    EMERGENCY_STOP_INPUT = 1 << 31


PLANE_MOVES = 1
"""The bit of PLANESTATUS that is on during a coordinated motion, such as LINEAR; AXISSTATUS does not show it."""

FAULTS: Mapping[int, str] = {
    0: "position error",
    1: "over-current",
    2: "clockwise end of travel",
    3: "counter-clockwise end of travel",
    4: "clockwise software limit",
    5: "counter-clockwise software limit",
    6: "amplifier",
    7: "position feedback",
    8: "velocity feedback",
    9: "Hall sensor",
    10: "commanded velocity above its threshold",
    11: "emergency stop",
    12: "velocity error",
    15: "external fault",
    17: "motor temperature",
    18: "amplifier temperature",
    19: "encoder",
    20: "communication lost",
    23: "feedback scaling",
    24: "marker search",
}
"""The bits of AXISFAULT by their numbers."""

ABORT_DECELERATION, HOME_SPEED, HOME_RAMP = 73, 76, 78
"""The numbers of the parameters for the deceleration of an axis by ABORT, and for the rate and ramp of homing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """One line from the controller: the outcome of the command, and the data after it."""

    outcome: Outcome
    data: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class EnsembleCommand:
    """One command: its name of one or two words, in capitals, and its arguments as they were written."""

    name: str
    arguments: tuple[str, ...] = ()


def parse_reply(line: str) -> Reply:
    """Return the reply in a line; raises `InstrumentError` if it begins with none of the four characters."""
    if not is_reply(line):
        raise InstrumentError(f"expected a line that begins with %, !, # or $, got {line[:MOST_SHOWN]!r}")
    return Reply(outcome=Outcome(line[0]), data=line[1:].strip())


def is_reply(line: str) -> bool:
    """Return whether a line begins with one of the four characters."""
    return line[:1] in {outcome.value for outcome in Outcome}


def is_bare(line: str) -> bool:
    """Return whether a line is a `%` without data, which has no meaning before the reply to a query."""
    return line == Outcome.DONE.value


def encode_reply(reply: Reply) -> bytes:
    """Return a reply as the controller sends it."""
    return f"{reply.outcome.value}{reply.data}".encode("ascii", "backslashreplace") + END


def parse_bits(data: str) -> int:
    """Return a word of 32 bits, 0 or above, from its signed or unsigned text; raises `InstrumentError` if invalid."""
    if not re.fullmatch(r"[+-]?[0-9]{1,10}", data) or not -(2**31) <= int(data) < 2**32:
        raise InstrumentError(f"expected an integer of 32 bits, got {data[:MOST_SHOWN]!r}")
    return int(data) & 0xFFFFFFFF


def written_bits(word: int) -> str:
    """Return a word of 32 bits as the controller writes it: signed."""
    return str(word - 2**32 if word & 2**31 else word)


def fault_names(word: int) -> tuple[str, ...]:
    """Return the names of the faults in an AXISFAULT word, lowest bit first; an unnamed bit by its number."""
    return tuple(FAULTS.get(bit, f"bit {bit}") for bit in range(32) if word >> bit & 1)


def parse_command(line: str) -> EnsembleCommand:
    """Return the command in a line; raises `UsageError` for a line without a name."""
    name, *words = re.split(r"[\s(),]+", line.strip())
    if not name.isalpha():
        raise UsageError(f"{line!r} is no command")
    if name.upper() in ("RAMP", "WAIT", "POSOFFSET", "PROGRAM") and words:
        name = f"{name} {words.pop(0)}"
    return EnsembleCommand(name=name.upper(), arguments=tuple(word for word in words if word))
