"""The command language SIMSERV of Weiss and Vötsch chambers with S!MPAC or Simpati. Converts texts and values; no I/O.

Sources: SiLab-Bonn/basil (weiss_labevent.py), IzaakWN/ClimateChamberMonitor (chamber_commands.py),
SengerM/VotschTechnik-climate-chamber-Python and ami3go's fork, whose authors checked the numbers in the maker's manual
"SIMPAC simserv". Not tried on hardware.

Fields are separated by byte 0xB6, "¶" in Latin-1. A command is a number of five digits, the chamber's index (always
"1") and at most four arguments, mostly the index of a variable or channel, from 1::

    11001¶1¶1¶25.0 CR        the set point of control variable 1, the temperature
    1 CR LF                  1: accepted, and the requested data: 1¶23.9 CR LF
    -6 CR LF                 refused, see `REFUSALS`

| number       | what                       | arguments; data                                                     |
|--------------|----------------------------|---------------------------------------------------------------------|
| 99997        | information                | 1 type, 2 year, 3 serial number                                     |
| 10012        | status                     | bits: 2 running, 4 warnings, 8 alarms; bit 1 is always set           |
| 11001, 11002 | write, read the set point  | control variable (and value)                                        |
| 11004        | actual value               | control variable                                                    |
| 11007, 11009 | lowest, highest set point  | control variable                                                    |
| 11068, 11066 | write, read the gradient   | control variable (and K/min), upwards; 11072, 11070 downwards       |
| 14001, 14003 | write, read a digital out  | channel (and 0 or 1); channel 1 starts and stops manual operation   |
| 17002        | number of messages         |                                                                     |
| 17005, 17007 | type, text of a message    | its index; 1 alarm, 2 warning, 4 information                        |
| 17009        | status of a message        | its index; 1 active                                                 |
| 19210, 19015 | status, stop of a program  | 0: none is running                                                  |
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from benchctl_instruments.protocols.lines import MOST_SHOWN, UnreadableError, parse_number

SEPARATOR, ENCODING = "¶", "latin-1"
CHAMBER = "1"
TEMPERATURE, START = 1, 1  # the control variable, the digital channel

INFO, STATUS = 99997, 10012
TYPE, YEAR, SERIAL = 1, 2, 3
SET_SETPOINT, GET_SETPOINT, GET_ACTUAL, GET_LOWEST, GET_HIGHEST = 11001, 11002, 11004, 11007, 11009
SET_GRADIENT_UP, GET_GRADIENT_UP, SET_GRADIENT_DOWN, GET_GRADIENT_DOWN = 11068, 11066, 11072, 11070
SET_DIGITAL, GET_DIGITAL = 14001, 14003
GET_MESSAGES, GET_MESSAGE_TYPE, GET_MESSAGE_TEXT, GET_MESSAGE_STATUS = 17002, 17005, 17007, 17009
GET_PROGRAM_STATUS, STOP_PROGRAM = 19210, 19015

RUNNING, ALARM = 2, 8  # bits of the status
ALARM_MESSAGE = 1  # a type of message

ACCEPTED, UNKNOWN, WRONG_PARAMETERS, UNREADABLE_DATA = 1, -5, -6, -8
REFUSALS: Mapping[int, str] = {
    UNKNOWN: "it does not know the command",
    WRONG_PARAMETERS: "parameters are missing or wrong",
    UNREADABLE_DATA: "the data could not be read",
}


def command(number: int, *arguments: float | str) -> str:
    """Return a command; floats are sent with one decimal."""
    texts = (f"{argument:.1f}" if isinstance(argument, float) else str(argument) for argument in arguments)
    return SEPARATOR.join((f"{number:05d}", CHAMBER, *texts))


def parse_command(line: str) -> tuple[int, tuple[str, ...]] | None:
    """Return the number and the arguments of a command, None if it is none."""
    number, *fields = line.split(SEPARATOR)
    if not re.fullmatch("[0-9]{5}", number) or not fields:
        return None
    return int(number), tuple(fields[1:])


def answer_line(code: int, *data: float | str) -> str:
    """Return an answer as the chamber sends it."""
    return SEPARATOR.join((str(code), *map(str, data)))


def read_answer(line: str) -> tuple[int, tuple[str, ...]]:
    """Return the code and the data of an answer."""
    code, *data = line.split(SEPARATOR)
    if not re.fullmatch("-?[0-9]{1,3}", code):
        raise UnreadableError(f"expected a code and data, got {line[:MOST_SHOWN]!r}")
    return int(code), tuple(data)


def read_number(line: str) -> float:
    """Return the number in the answer to a query that was accepted."""
    return parse_number(read_text(line))


def read_whole(line: str) -> int:
    """Return the integer in the answer to a query that was accepted."""
    number = read_number(line)
    if number != int(number):
        raise UnreadableError(f"expected an integer, got {line[:MOST_SHOWN]!r}")
    return int(number)


def read_text(line: str) -> str:
    """Return the first datum of the answer to a query that was accepted."""
    code, data = read_answer(line)
    if code != ACCEPTED or not data:
        raise UnreadableError(f"expected a datum, got {line[:MOST_SHOWN]!r}")
    return data[0]


def read_accepted(line: str) -> None:
    """Check the answer to a command that was not refused."""
    code, _ = read_answer(line)
    if code != ACCEPTED:
        raise UnreadableError(f"expected {ACCEPTED}, got {line[:MOST_SHOWN]!r}")
