r"""The command language of ESPEC's P-300 and SCP-220 chamber controllers. Converts texts and values; no I/O.

Sources: EspecNorthAmerica/ChamberConnectLibrary (p300.py, especinteract.py), akaeba/ATWG (ESPEC SH-641), and answers of
an MC-811P (SCP-220) that its owner recorded in the tests of an open driver. Not tried on hardware.

A request is a line of ASCII with CR LF, and every line is answered with one line::

    TEMP? CR LF                        a query: its name ends with a question mark
    MODE?,DETAIL CR LF                 parameters follow after commas
    3,TEMP? CR LF                      on RS-485: the chamber's address before it, none before the answer
    TEMP, S25.0 H130.0 L-45.0 CR LF    a command: set point, high and low alarm, each of them optional

    27.0,50.0,185.0,-90.0 CR LF        data; blanks after the commas on some chambers
    OK:TEMP, S25.0 CR LF               a command was accepted; the text after OK is ignored
    NA:DATA OUT OF RANGE CR LF         it was refused, with the reason: see `REFUSALS`

| query          | answer                                                          | reader              |
|----------------|-----------------------------------------------------------------|---------------------|
| `TEMP?`        | air, set point (a word if it is off), high, low alarm, in °C    | `read_temperatures` |
| `MODE?`        | a word of `MODES`; with `,DETAIL` one of `DETAILED_MODES`       | `read_mode`         |
| `ALARM?`       | the number of alarms, and their codes                           | `read_alarms`       |
| `TYPE?`        | sensors, controller, highest set point                          | `read_type`         |
| `ROM?`         | version, a text                                                 | (itself)            |
| `%?`           | the number of outputs, heater [%], humidifier [%]               | `read_heater`       |

Some chambers can be set to answer a query with two lines, an OK with its echo and then the data: `is_accepted`
recognizes the first one. A set point beyond the alarms is refused. There is no public list of the alarm codes.

Accepted input: that of `protocols.lines`; for any text, a reader returns or raises `UnreadableError`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from benchctl_instruments.errors import UsageError
from benchctl_instruments.protocols.lines import UnreadableError as UnreadableError
from benchctl_instruments.protocols.lines import tenths as tenths

REFUSALS: Mapping[str, str] = {
    "CMD ERR": "it does not know the command",
    "ADDR ERR": "the command takes no address, or another one",
    "CONT NOT READY-1": "it has no humidity control and no product temperature control",
    "CONT NOT READY-2": "it runs no program",
    "CONT NOT READY-3": "this controller does not have the command",
    "CONT NOT READY-4": "the keys cannot be locked while it is off",
    "CONT NOT READY-5": "that time signal is not enabled",
    "DATA NOT READY": "the requested data do not exist, or not yet",
    "PARA ERR": "a parameter is missing or cannot be read",
    "DATA OUT OF RANGE": "the value lies outside its range; a set point must lie between the low and the high alarm",
    "PROTECT ON": "settings are protected at its panel; lift the protection there",
    "INVALID REQ": "it does not have that function",
    "CHB NOT READY": "it cannot do that in its present state: switched off at the panel, or a program runs",
}
PROGRAM_REFUSAL = "a program cannot be written in that way"  # PRGM WRITE ERR-1 to -15
PASSING_REFUSALS = ("CHB NOT READY", "DATA NOT READY")

OFF, STANDBY, CONSTANT, RUN = MODES = ("OFF", "STANDBY", "CONSTANT", "RUN")
DETAILED_MODES = (*MODES, "RUN PAUSE", "RUN END HOLD", "RMT RUN", "RMT RUN PAUSE", "RMT RUN END HOLD")

TYPE_QUERY, ROM_QUERY, MODE_QUERY = "TYPE?", "ROM?", "MODE?"
TEMP_QUERY, ALARM_QUERY, HEATER_QUERY = "TEMP?", "ALARM?", "%?"

_NUMBER = re.compile(r"[+-]?[0-9]{1,9}(\.[0-9]{0,9})?")
_SETTING = re.compile(r"([SHL])\s*([+-]?[0-9]{1,9}(?:\.[0-9]{0,9})?)(?:[\s,]+|$)")


@dataclass(frozen=True, slots=True, kw_only=True)
class Temperatures:
    """Air, set point and its alarm limits, all in °C; the set point is None if it is switched off."""

    air_c: float
    setpoint_c: float | None
    high_c: float
    low_c: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """A line as the controller parses it: names and parameters in capitals, without surrounding blanks."""

    address: int | None
    name: str
    query: bool
    parameters: tuple[str, ...]


# Requests -------------------------------------------------------------------------------------------------------------


def set_temperatures(*, setpoint_c: float, high_c: float | None = None, low_c: float | None = None) -> str:
    """Return the command for a set point and optionally the alarms; raises `UsageError` if a number is not finite."""
    settings = {"S": setpoint_c, "H": high_c, "L": low_c}
    stated = {letter: value for letter, value in settings.items() if value is not None}
    if not all(map(math.isfinite, stated.values())):
        raise UsageError(f"temperatures {', '.join(f'{value:g}' for value in stated.values())} °C; give finite numbers")
    return "TEMP, " + " ".join(f"{letter}{tenths(value):.1f}" for letter, value in stated.items())


def set_mode(mode: str) -> str:
    """Return the command for a mode of `MODES`, except RUN, which requires a program number."""
    return f"MODE,{mode}"


def addressed(request: str, address: int | None) -> str:
    """Return a request as sent over RS-485, or unchanged if there is no address."""
    return request if address is None else f"{address},{request}"


def data_line(*values: float | int | str | None) -> str:
    """Return an answer as the controller sends it: floats with one decimal, counts and words unchanged, None empty."""
    return ",".join(
        "" if value is None else f"{tenths(value):.1f}" if isinstance(value, float) else str(value) for value in values
    )


# Answers --------------------------------------------------------------------------------------------------------------


def is_accepted(line: str) -> bool:
    """Return whether a line is an OK."""
    return line.upper().startswith("OK")


def read_accepted(line: str) -> None:
    """Check the answer to a command that was not refused."""
    if not is_accepted(line):
        raise _unreadable(line, "OK")


def refusal(line: str) -> str | None:
    """Return the controller's reason of a refusal ("" if it states none); None if the line is no refusal."""
    found = re.fullmatch(r"NA(?::\s*(.*))?", line.strip().upper())
    return None if found is None else " ".join((found[1] or "").replace("_", " ").split())


def refusal_words(reason: str) -> str:
    """Return the meaning of a reason."""
    return PROGRAM_REFUSAL if reason.startswith("PRGM WRITE ERR") else REFUSALS.get(reason, "see the chamber's manual")


def read_temperatures(line: str) -> Temperatures:
    """Parse the answer to TEMP?."""
    what = "air, set point, high and low alarm"
    air, setpoint, high, low = _fields(line, what, 4)
    return Temperatures(
        air_c=_number(air, line, what),
        setpoint_c=None if setpoint.isalpha() else _number(setpoint, line, what),
        high_c=_number(high, line, what),
        low_c=_number(low, line, what),
    )


def read_mode(line: str) -> str:
    """Parse the answer to MODE? or MODE?,DETAIL, in the spelling of `DETAILED_MODES`."""
    mode = " ".join(line.upper().split())
    if mode not in DETAILED_MODES:
        raise _unreadable(line, "a mode")
    return mode


def read_alarms(line: str) -> tuple[int, ...]:
    """Parse the answer to ALARM?: the codes of the active alarms."""
    what = "the number of alarms and their codes"
    count, *codes = (_count(field.strip(), line, what) for field in line.split(","))
    if count != len(codes):
        raise _unreadable(line, what)
    return tuple(codes)


def read_type(line: str) -> str:
    """Return the controller's name from the answer to TYPE?."""
    what = "sensors, controller and highest set point"
    *_, controller, highest = _fields(line, what, 3, 4)
    _number(highest, line, what)
    return controller


def read_heater(line: str) -> float:
    """Return the heater's output, in percent, from the answer to %?."""
    what = "the number of outputs and what they put out"
    count, *outputs = _fields(line, what, 2, 3)
    if _count(count, line, what) != len(outputs):
        raise _unreadable(line, what)
    heater, *_ = (_number(output, line, what) for output in outputs)
    return heater


def parse_request(line: str) -> Request:
    """Parse a line as the controller does; the controller decides whether the command exists."""
    first, *rest = (" ".join(part.upper().split()) for part in line.split(","))
    address = int(first) if rest and re.fullmatch("[0-9]{1,3}", first) else None
    name, *parameters = rest if address is not None else (first, *rest)
    return Request(address=address, name=name.removesuffix("?"), query=name.endswith("?"), parameters=tuple(parameters))


def parse_settings(parameters: Sequence[str]) -> dict[str, float] | None:
    """Return the numbers after the letters S, H and L of a TEMP command; None if they are invalid."""
    text = ",".join(parameters)
    found = _SETTING.findall(text)
    complete = _SETTING.sub("", text) == ""
    settings = {letter: float(number) for letter, number in found}
    return settings if found and complete and len(settings) == len(found) else None


def _fields(line: str, what: str, *counts: int) -> list[str]:
    fields = [field.strip() for field in line.split(",")]
    if len(fields) not in counts:
        raise _unreadable(line, what)
    return fields


def _number(field: str, line: str, what: str) -> float:
    if _NUMBER.fullmatch(field) is None:
        raise _unreadable(line, what)
    return float(field)


def _count(field: str, line: str, what: str) -> int:
    if re.fullmatch("[0-9]{1,9}", field) is None:
        raise _unreadable(line, what)
    return int(field)


def _unreadable(line: str, what: str) -> UnreadableError:
    return UnreadableError(f"expected {what}, got {line[:64]!r}")
