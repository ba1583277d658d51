r"""The command language of Newport's ESP300, ESP301 and ESP302. Lines in, commands and answers out; no I/O here.

Source: openly published driver code (epics-motor/motorNewport drvESP300.cc, pymeasure newport/esp300.py,
IEAv-EFO/esp301); the order of `MV`, `ST` and `MV` is that of an example on a public copy of a page of the maker's
manual. Not tried on hardware.

A line is ASCII and ends with CR; it holds one command or several, parted by `;`. Only queries are answered::

    1VA50.000000 CR                    axis, two letters, value: the velocity of axis 1
    1OR1;1WS CR                        axis 1 is homed; what follows WS waits until the axis rests
    1MV+ CR                            axis 1 turns, until it is told to stop
    1TP? CR                            a query; the `?` may be missing after TP, TV and MD

    12.345678 CR LF                    its answer

What is wrong with a command shows in a queue of errors. `TE?` takes the oldest one out and answers its code, `TB?`
answers code, time and text, parted by commas; both answer 0 where the queue is empty. From 100 on a code is that of
an axis: 100 times its number and what is wrong with it. A query that is itself wrong is not answered at all. What
was taken out is gone, whether or not its answer arrived: an error whose code was lost on the way has none here.

Assumed, because no source says so: `TV` answers the velocity with its sign; a velocity that is set while an axis turns
by `MV` takes effect at once; a rejected command does not keep those behind it on the same line from being obeyed.

Survived: a line `E` and a number, which the ESP300 was seen to say unasked before an answer. What else can go wrong
with lines is a matter of `benchctl_instruments.protocols.lines`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols.lines import MOST_SHOWN

SENT_END, ANSWER_END = b"\r", b"\r\n"
DEGREES = 7
"""What `SN?` answers where an axis counts in degrees."""

GENERAL_ERRORS: Mapping[int, str] = {
    1: "PCI communication time-out",
    4: "emergency stop",
    6: "no such command",
    7: "parameter out of range",
    8: "cable interlock",
    9: "no such axis",
    23: "servo cycle tick failure",
    27: "command not allowed",
    37: "the axis is missing",
    38: "the parameter is missing",
}
AXIS_ERRORS: Mapping[int, str] = {
    0: "motor type not defined",
    1: "parameter out of range",
    2: "amplifier fault",
    3: "following error",
    4: "positive hardware limit",
    5: "negative hardware limit",
    6: "positive software limit",
    7: "negative software limit",
    8: "motor or stage not connected",
    9: "feedback signal fault",
    10: "maximum velocity exceeded",
    11: "maximum acceleration exceeded",
    13: "motor not enabled",
    20: "homing aborted",
    22: "drive communication error",
    23: "drive not detected",
    24: "speed out of range",
    29: "interlock on the digital inputs",
    30: "not allowed during homing",
}
_GENERAL_FAULTS = {4, 8, 23}
_AXIS_FAULTS = {2, 3, 4, 5, 6, 7, 8, 9, 22, 23, 29}

MOST_CODE = 999
_COMMAND = re.compile(r"(?P<axis>\d{0,2})(?P<name>[*]IDN|[A-Z]{2})(?P<value>[^?]*)(?P<query>\??)", re.ASCII | re.I)
_UNASKED = re.compile(r"E *[0-9]+\b.*", re.ASCII)
_ESCAPE = re.compile(r"\\x[0-9a-f]{2}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Esp301Command:
    """One command: `axis` is None where none is named, `value` what stands behind the letters, without blanks."""

    axis: int | None
    name: str
    value: str = ""
    query: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Error:
    """One error out of the controller's queue; `code` is None where it was lost on the line."""

    code: int | None

    @property
    def fault(self) -> bool:
        """Whether the axis cannot go on, whatever it was told; otherwise a command was wrong. A lost one may be any."""
        if self.code is None:
            return True
        if self.code < 100:
            return self.code in _GENERAL_FAULTS
        return self.code % 100 in _AXIS_FAULTS

    @property
    def text(self) -> str:
        """What it says, without its code."""
        if self.code is None:
            return "an error whose code was lost on the line"
        if self.code < 100:
            return GENERAL_ERRORS.get(self.code, "unknown")
        return f"axis {self.code // 100}: {AXIS_ERRORS.get(self.code % 100, 'unknown')}"

    def __str__(self) -> str:
        return self.text if self.code is None else f"{self.code} ({self.text})"


def parse_error(answer: str) -> Error | None:
    """The error that `TE?` or `TB?` answered with, None for 0; `InstrumentError` for what is no code."""
    code = answer.partition(",")[0].strip()
    if not re.fullmatch(r"[0-9]{1,3}", code):
        raise InstrumentError(f"expected the code of an error, 0 to {MOST_CODE}, got {answer[:MOST_SHOWN]!r}")
    return Error(code=int(code)) if int(code) else None


def held_an_error(damaged: str) -> bool:
    """Whether an answer to `TE?` that cannot be read was that of an error: of a 0, the 0 would be left."""
    return set(re.findall("[0-9]", _ESCAPE.sub("", damaged))) != {"0"}


def parse_flag(answer: str) -> bool:
    """Whether it is 1; `InstrumentError` for what is neither 1 nor 0."""
    if answer not in ("0", "1"):
        raise InstrumentError(f"expected 0 or 1, got {answer[:MOST_SHOWN]!r}")
    return answer == "1"


def is_unasked(line: str) -> bool:
    """Whether it is an error that nobody asked for."""
    return _UNASKED.fullmatch(line) is not None


def parse_commands(line: str) -> Iterator[Esp301Command | None]:
    """The commands of one line, names in capitals; None in the place of what is no command."""
    for item in line.split(";"):
        text = item.replace(" ", "")
        if not text:
            continue
        if not (match := _COMMAND.fullmatch(text)):
            yield None
            continue
        axis, name, value, query = match.group("axis", "name", "value", "query")
        yield Esp301Command(axis=int(axis) if axis else None, name=name.upper(), value=value, query=query == "?")
