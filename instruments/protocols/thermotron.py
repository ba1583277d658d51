"""The commands of Thermotron's 3800 and 8800 controllers. Converts texts and values; no I/O.

Sources. 8800: the maker's "Interface Command Descriptions" (Commands.html among its software updates), and two public
clients, one a Python class over TCP port 8888 that repeats them, one that looks at the answers to commands. 3800:
PyMeasure (thermotron3800.py). Not tried on hardware.

A line is a mnemonic of four letters, a channel for some, and "?" for a query or "," and a value; channel 1 is the air.
Lines end as the controller is set: CR, LF or both::

    PVAR1? CR LF          the air: 22.000
    SETP1,-40.0 CR LF     the set point; an 8800 answers 0 if it accepts it, a 3800 does not answer commands

| mnemonic | what                                                                       | 3800 | 8800 |
|----------|----------------------------------------------------------------------------|------|------|
| IDEN?    | the controller's name                                                      | yes  | yes  |
| VRSN?    | the version of its software                                                |      | yes  |
| PVAR1?   | the temperature of the air                                                 | yes  | yes  |
| SETP1    | the set point; a 3800, and a stopped 8800, take it over at RUNM            | yes  | yes  |
| RUNM     | run in manual mode                                                         | yes  | yes  |
| STOP     | stop                                                                       | yes  | yes  |
| MODE?    | bits of `MANUAL` and others                                                | yes  |      |
| SCOD?    | why it stopped, see `STOPS`; 1 if it runs                                  |      | yes  |
| ALRM1?   | bits of `PROCESS_ALARMS`; bits 0 and 1 are alarms of the deviation         |      | yes  |
| THTL1?   | the throttle of the channel, in percent                                    |      | yes  |
| MRMP1    | the ramp of manual mode, in °C/min                                         |      | yes  |
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from benchctl_instruments.protocols.lines import MOST_SHOWN, UnreadableError, parse_number

IDENTITY, VERSION, AIR, THROTTLE = "IDEN?", "VRSN?", "PVAR1?", "THTL1?"
SETPOINT, RAMP = "SETP1", "MRMP1"
RUN, STOP = "RUNM", "STOP"
MODE, STOP_CODE, ALARM = "MODE?", "SCOD?", "ALRM1?"

ACCEPTED = 0
PROGRAM, STOPPED, HOLD, MANUAL, DELAYED, CALIBRATION = 1, 2, 8, 16, 32, 128  # bits of the mode of a 3800
OF_A_PROGRAM = PROGRAM | HOLD | DELAYED
PROCESS_ALARMS: Mapping[int, str] = {16: "low process alarm", 32: "high process alarm"}
RUNNING, BY_COMPUTER, BY_PROCESS_ALARM = 1, 5, 7
STOPS: Mapping[int, str] = {
    0: "it was switched on",
    2: "the stop key was pressed",
    3: "a test ended",
    4: "an external input stopped it",
    BY_COMPUTER: "a computer stopped it",
    6: "the input of a sensor is open",
    BY_PROCESS_ALARM: "a process alarm",
    8: "its System Monitor tripped",
    9: "the power failed",
    10: "its Therm-Alarm tripped",
}


def read_name(line: str, model: str) -> str:
    """Return the answer to `IDENTITY` if it names a model."""
    if model not in line:
        raise UnreadableError(f"expected the name of a Thermotron {model}, got {line[:MOST_SHOWN]!r}")
    return f"Thermotron {line}"


def set_value(mnemonic: str, value: float) -> str:
    """Return the command that sets a value."""
    return f"{mnemonic},{value:.1f}"


def query(mnemonic: str) -> str:
    """Return the query of a value that can be set."""
    return f"{mnemonic}?"


def value_line(value: float) -> str:
    """Return a value as the controllers send it."""
    return f"{value:.3f}"


def read_code(line: str) -> int:
    """Return a coded integer."""
    number = parse_number(line)
    if number != int(number):
        raise UnreadableError(f"expected a coded integer, got {line[:MOST_SHOWN]!r}")
    return int(number)


def parse_command(line: str) -> tuple[str, str | None] | None:
    """Return the mnemonic with channel and "?", and the value if there is one; None if the line is no command."""
    found = re.fullmatch(r"([A-Z]{4}[0-9]{0,2}\??)(?:,([^,]*))?", line.strip().upper())
    return None if found is None else (found[1], found[2])
