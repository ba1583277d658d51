"""A simulated Weiss or Vötsch chamber with SIMSERV. It shares only the command language with the driver.

It has one control variable, the temperature, six further digital outputs, and three messages. The numbers of the
commands are those that public clients use.

Behaviour chosen without a source: a set point beyond its range is refused with -6, an index that it does not have with
-8; a start is refused with -6 while a program runs; air beyond its range by more than 5 K while the chamber conditions
raises the alarm. Gradients are stored and do not slow the air, which has the machine's own ramp. There is no program
except the one that is started at the panel.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from typing import TypeVar

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols import simserv
from benchctl_instruments.protocols.lines import encode_line, parse_number
from benchctl_instruments.protocols.simserv import answer_line
from benchctl_instruments.simulated.faults.wires import Lines
from benchctl_instruments.simulated.machines import ChamberMachine
from benchctl_instruments.simulated.serial_line import LineServer

INFORMATION = ("LabEvent T/210/70/5", "26", "SIMULATED")
LOWEST_C, HIGHEST_C, BEYOND_K = -75.0, 180.0, 5.0
OUTPUTS = ("Start", "Cond.protect", "Custom 1", "Custom 2", "Compressed air", "Air dryer", "Custom 3", "Custom 4")
MESSAGES = (("Temperature beyond its limits", 1), ("Water tank low", 2), ("Door opened", 4))  # text and type
COUNTS = {11018: 1, 12012: 0, 13007: 0, 14007: len(OUTPUTS), 15004: 0, simserv.GET_MESSAGES: len(MESSAGES)}
CONSTANTS = {  # of control variable 1: name, unit, limits of the set point
    11026: "Temperature",
    11023: "°C",
    simserv.GET_LOWEST: f"{LOWEST_C}",
    simserv.GET_HIGHEST: f"{HIGHEST_C}",
}

Item = TypeVar("Item")


class _RefusedError(Exception):
    """The code of a refusal."""


class SimservController:
    """The chamber's states over a `ChamberMachine`, without I/O. Thread-safe.

    `active` holds the indices of its active messages; the first is the alarm of the air. `program` is the status of a
    program: 0 for none, 1 running.
    """

    def __init__(self, chamber: ChamberMachine) -> None:
        self._chamber = chamber
        self._lock = threading.Lock()
        self._gradients = {simserv.GET_GRADIENT_UP: 0.0, simserv.GET_GRADIENT_DOWN: 0.0}
        self._outputs = [False] * len(OUTPUTS)
        self.active: set[int] = set()
        self.program = 0
        self._commands: dict[int, Callable[..., object]] = {
            simserv.INFO: lambda which: _item(INFORMATION, which),
            simserv.STATUS: lambda *_: self._status(),
            simserv.GET_SETPOINT: lambda variable: _first(variable, f"{chamber.setpoint_c():.1f}"),
            simserv.GET_ACTUAL: lambda variable: _first(variable, f"{chamber.air_c():.1f}"),
            simserv.SET_SETPOINT: self._set_setpoint,
            simserv.SET_GRADIENT_UP: lambda *fields: self._set_gradient(simserv.GET_GRADIENT_UP, *fields),
            simserv.SET_GRADIENT_DOWN: lambda *fields: self._set_gradient(simserv.GET_GRADIENT_DOWN, *fields),
            simserv.GET_DIGITAL: lambda channel: int(_item(self._output_states(), channel)),
            simserv.SET_DIGITAL: self._set_output,
            14010: lambda number: _item(OUTPUTS[1:], number),
            simserv.GET_MESSAGE_TEXT: lambda index: _item(MESSAGES, index)[0],
            simserv.GET_MESSAGE_TYPE: lambda index: _item(MESSAGES, index)[1],
            simserv.GET_MESSAGE_STATUS: lambda index: int(bool(_item(MESSAGES, index)) and int(index) in self.active),
            17012: lambda *_: self.active.clear(),
            simserv.GET_PROGRAM_STATUS: lambda *_: self.program,
            simserv.STOP_PROGRAM: lambda *_: self._end_program(),
        }
        self._commands |= {number: lambda *_, count=count: count for number, count in COUNTS.items()}
        for number, text in CONSTANTS.items():
            self._commands[number] = lambda variable, text=text: _first(variable, text)
        for number in self._gradients:
            self._commands[number] = lambda variable, number=number: _first(variable, f"{self._gradients[number]:.1f}")

    def run_program(self) -> None:
        """Start a program, as at the panel."""
        with self._lock:
            self.program = 1
            self._chamber.run(True)

    def execute(self, line: str) -> str:
        """Execute one command and return the answer."""
        parsed = simserv.parse_command(line)
        if parsed is None or parsed[0] not in self._commands:
            return answer_line(simserv.UNKNOWN)
        number, arguments = parsed
        with self._lock:
            self._look_at_air()
            try:
                datum = self._commands[number](*arguments)
            except _RefusedError as refused:
                return answer_line(int(str(refused)))
            except (InstrumentError, TypeError):  # a value that is no number; too few or too many arguments
                return answer_line(simserv.WRONG_PARAMETERS)
        return answer_line(simserv.ACCEPTED) if datum is None else answer_line(simserv.ACCEPTED, str(datum))

    def _status(self) -> int:
        types = {MESSAGES[index - 1][1] for index in self.active}
        running = simserv.RUNNING if self._chamber.running() else 0
        return 1 | running | (4 if 2 in types else 0) | (simserv.ALARM if simserv.ALARM_MESSAGE in types else 0)

    def _set_setpoint(self, variable: str, value: str) -> None:
        setpoint_c = parse_number(value)
        _first(variable, "")
        if not LOWEST_C <= setpoint_c <= HIGHEST_C:
            raise _RefusedError(simserv.WRONG_PARAMETERS)
        self._chamber.set_setpoint(setpoint_c)

    def _set_gradient(self, number: int, variable: str, value: str) -> None:
        gradient = parse_number(value)
        _first(variable, "")
        if gradient < 0.0:
            raise _RefusedError(simserv.WRONG_PARAMETERS)
        self._gradients[number] = gradient

    def _output_states(self) -> list[bool]:
        return [self._chamber.running() and not self.program, *self._outputs[1:]]

    def _set_output(self, channel: str, value: str) -> None:
        _item(OUTPUTS, channel)
        if value not in ("0", "1"):
            raise _RefusedError(simserv.WRONG_PARAMETERS)
        if int(channel) != simserv.START:
            self._outputs[int(channel) - 1] = value == "1"
        elif self.program:
            raise _RefusedError(simserv.WRONG_PARAMETERS)
        elif self._chamber.running() is not (value == "1"):
            self._chamber.run(value == "1")

    def _end_program(self) -> None:
        if self.program:
            self.program = 0
            self._chamber.run(False)

    def _look_at_air(self) -> None:
        beyond_k = max(LOWEST_C - self._chamber.air_c(), self._chamber.air_c() - HIGHEST_C)
        if self._chamber.running() and (beyond_k > BEYOND_K or math.isnan(beyond_k)):
            self.active.add(1)


def _item(items: Sequence[Item], index: str) -> Item:
    if not (index.isdecimal() and 1 <= int(index) <= len(items)):
        raise _RefusedError(simserv.UNREADABLE_DATA)
    return items[int(index) - 1]


def _first(variable: str, text: str) -> str:
    """Return the text of the only control variable."""
    return _item((text,), variable)


class SimulatedWeissSimserv(LineServer):
    """A chamber at `tcp://host:port`; a driver uses its `address`. `controller` provides the actions at the panel."""

    wire = Lines(refusal_line=encode_line(answer_line(simserv.UNREADABLE_DATA)))

    def __init__(self, chamber: ChamberMachine) -> None:
        self.controller = SimservController(chamber)
        super().__init__(self.controller.execute, over_tcp=True, encoding=simserv.ENCODING)


Twin = SimulatedWeissSimserv
