r"""The command language of Newport's ESP300, ESP301 and ESP302. Converts lines, commands and answers; no I/O.

Source: openly published driver code (epics-motor/motorNewport drvESP300.cc, pymeasure newport/esp300.py,
IEAv-EFO/esp301); the order of `MV`, `ST` and `MV` is that of an example on a public copy of a page of the
manufacturer's manual. Not tried on hardware.

A line is ASCII and ends with CR; it holds one or several commands, separated by `;`. Only queries are answered::

    1VA50.000000 CR                    axis, two letters, value: the velocity of axis 1
    1OR1;1WS CR                        axis 1 is homed; commands after WS wait until the axis rests
    1MV+ CR                            axis 1 turns until it is stopped
    1TP? CR                            a query; the `?` may be missing after TP, TV and MD

    12.345678 CR LF                    its answer

Faults of commands are stored in a queue of errors. `TE?` removes the oldest one and answers its code, `TB?` answers
code, time and text, separated by commas; both answer 0 if the queue is empty. A code from 100 on is that of an axis:
100 times the axis number plus the fault. A faulty query is not answered at all. A removed error is lost even if its
answer did not arrive: such an error has no code here.

Assumptions without a source: `TV` answers the velocity with its sign; a velocity that is set while an axis turns by
`MV` takes effect at once; a rejected command does not prevent later commands on the same line.

Accepted input: a line with `E` and a number, which an ESP300 sent unsolicited before an answer. Other disturbances of
lines are handled in `benchctl_instruments.protocols.lines`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols.lines import MOST_SHOWN

SENT_END, ANSWER_END = b"\r", b"\r\n"
DEGREES = 7
"""The answer to `SN?` of an axis that counts in degrees."""

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
    """One command: `axis` is None if none is named, `value` is the text after the letters, without blanks."""

    axis: int | None
    name: str
    value: str = ""
    query: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Error:
    """One error from the controller's queue; `code` is None if it was lost on the line."""

    code: int | None

    @property
    def fault(self) -> bool:
        """Whether the axis cannot continue; otherwise a command was invalid. A lost error is treated as a fault."""
        if self.code is None:
            return True
        if self.code < 100:
            return self.code in _GENERAL_FAULTS
        return self.code % 100 in _AXIS_FAULTS

    @property
    def text(self) -> str:
        """Its meaning, without its code."""
        if self.code is None:
            return "an error whose code was lost on the line"
        if self.code < 100:
            return GENERAL_ERRORS.get(self.code, "unknown")
        return f"axis {self.code // 100}: {AXIS_ERRORS.get(self.code % 100, 'unknown')}"

    def __str__(self) -> str:
        return self.text if self.code is None else f"{self.code} ({self.text})"


def parse_error(answer: str) -> Error | None:
    """Return the error in an answer to `TE?` or `TB?`, None for 0; raises `InstrumentError` if it is not a code."""
    code = answer.partition(",")[0].strip()
    if not re.fullmatch(r"[0-9]{1,3}", code):
        raise InstrumentError(f"expected the code of an error, 0 to {MOST_CODE}, got {answer[:MOST_SHOWN]!r}")
    return Error(code=int(code)) if int(code) else None


def held_an_error(damaged: str) -> bool:
    """Return whether an unreadable answer to `TE?` contained an error: it did unless its only digits are 0."""
    return set(re.findall("[0-9]", _ESCAPE.sub("", damaged))) != {"0"}


def parse_flag(answer: str) -> bool:
    """Return whether a flag is 1; raises `InstrumentError` if it is neither 1 nor 0."""
    if answer not in ("0", "1"):
        raise InstrumentError(f"expected 0 or 1, got {answer[:MOST_SHOWN]!r}")
    return answer == "1"


def is_unasked(line: str) -> bool:
    """Return whether a line is an unsolicited error."""
    return _UNASKED.fullmatch(line) is not None


def parse_commands(line: str) -> Iterator[Esp301Command | None]:
    """Yield the commands of one line, names in capitals; None in place of an invalid command."""
    for item in line.split(";"):
        text = item.replace(" ", "")
        if not text:
            continue
        if not (match := _COMMAND.fullmatch(text)):
            yield None
            continue
        axis, name, value, query = match.group("axis", "name", "value", "query")
        yield Esp301Command(axis=int(axis) if axis else None, name=name.upper(), value=value, query=query == "?")
