"""What the simulated chambers with Thermotron's controllers have in common; the drivers share only the mnemonics.

Behaviour chosen without a source: a line that is no command, a set point outside -75 to 180 °C and what the present
mode does not allow have no effect, and are answered with `REFUSED` where commands are answered; a wrong query is not
answered. There is no program except the one that is started at the panel.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols import thermotron
from benchctl_instruments.protocols.lines import parse_number
from benchctl_instruments.protocols.thermotron import value_line
from benchctl_instruments.simulated.machines import ChamberMachine

LOWEST_C, HIGHEST_C = -75.0, 180.0
REFUSED = 1


class _RefusedError(Exception):
    """The controller does not do that."""


class ThermotronController(ABC):
    """The controller's states over a `ChamberMachine`, without I/O. Thread-safe.

    `program` is whether a program runs; it is started at the panel.
    """

    NAME: ClassVar[str]
    COMMANDS_ANSWERED: ClassVar[bool]

    def __init__(self, chamber: ChamberMachine) -> None:
        self._chamber = chamber
        self._lock = threading.Lock()
        self._waiting_c: float | None = None  # a set point for the next RUNM
        self.program = False
        self._queries: dict[str, Callable[[], str]] = {
            thermotron.IDENTITY: lambda: self.NAME,
            thermotron.AIR: lambda: value_line(chamber.air_c()),
            thermotron.query(thermotron.SETPOINT): lambda: value_line(chamber.setpoint_c()),
        }
        self._commands: dict[str, Callable[[], None]] = {thermotron.RUN: self._run, thermotron.STOP: self._stop}
        self._settings: dict[str, Callable[[float], None]] = {thermotron.SETPOINT: self._set_setpoint}

    def run_program(self) -> None:
        """Start a program, as at the panel."""
        with self._lock:
            self.program = True
            self._switch(on=True)

    def stop_by_itself(self) -> None:
        """Stop, as after a fault."""
        with self._lock:
            self._stop()

    def execute(self, line: str) -> str | None:
        """Execute one line; return the answer, or None."""
        mnemonic, value = thermotron.parse_command(line) or ("", None)
        with self._lock:
            self._look_at_air()
            if mnemonic.endswith("?"):
                return self._queries[mnemonic]() if value is None and mnemonic in self._queries else None
            try:
                if value is not None and mnemonic in self._settings:
                    self._settings[mnemonic](parse_number(value))
                elif value is None and mnemonic in self._commands:
                    self._commands[mnemonic]()
                else:
                    raise _RefusedError
                code = thermotron.ACCEPTED
            except (_RefusedError, InstrumentError):  # also a value that is no number
                code = REFUSED
        return str(code) if self.COMMANDS_ANSWERED else None

    def _set_setpoint(self, setpoint_c: float) -> None:
        if self.program or not LOWEST_C <= setpoint_c <= HIGHEST_C:
            raise _RefusedError
        self._waiting_c = setpoint_c

    def _run(self) -> None:
        if self.program:
            raise _RefusedError
        self._take_over()
        self._switch(on=True)

    def _take_over(self) -> None:
        if self._waiting_c is not None:
            self._chamber.set_setpoint(self._waiting_c)
        self._waiting_c = None

    def _stop(self) -> None:
        self.program = False
        self._switch(on=False)

    def _switch(self, *, on: bool) -> None:
        if self._chamber.running() is not on:
            self._chamber.run(on)

    @abstractmethod
    def _look_at_air(self) -> None: ...
