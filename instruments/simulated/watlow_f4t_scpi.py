"""A simulated chamber with a Watlow F4T at its SCPI port; the driver shares only the grammar of SCPI.

Written from public clients, see `chambers.watlow_f4t_scpi`. Behaviour chosen without a source: its identity, the words
for the state of a profile, and that what it does not know, or cannot do, has neither effect nor answer.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols import scpi
from benchctl_instruments.protocols.lines import parse_number
from benchctl_instruments.simulated.machines import ChamberMachine
from benchctl_instruments.simulated.serial_line import LineServer

IDENTITY = "WATLOW ELECTRIC,F4T SIMULATED,1,1.0"
LOWEST_C, HIGHEST_C = -75.0, 185.0
STATES = {"START": "RUN", "STOP": "IDLE", "PAUSE": "HOLD", "RESUME": "RUN"}


class F4TController:
    """The controller's states over a `ChamberMachine`, without I/O. Thread-safe.

    `unit` is C or F; `profile` is the state of the selected profile.
    """

    def __init__(self, chamber: ChamberMachine, *, loop: int, on_number: int) -> None:
        self._chamber = chamber
        self._lock = threading.Lock()
        self.unit, self.profile = "C", "IDLE"
        self._handlers: dict[str, Callable[..., str | None]] = {
            "*IDN?": lambda: IDENTITY,
            "UNITs:TEMPerature?": lambda: self.unit,
            "UNITs:TEMPerature": self._set_unit,
            f"SOURce:CLOop{loop}:PVALue?": lambda: self._shown(chamber.air_c()),
            f"SOURce:CLOop{loop}:SPOint?": lambda: self._shown(chamber.setpoint_c()),
            f"SOURce:CLOop{loop}:SPOint": self._set_setpoint,
            f"OUTPut{on_number}:STATe?": lambda: "ON" if chamber.running() else "OFF",
            f"OUTPut{on_number}:STATe": self._switch,
            "PROGram[:SELected]:STATe?": lambda: self.profile,
            "PROGram[:SELected]:STATe": lambda state: setattr(self, "profile", STATES.get(state.upper(), self.profile)),
        }

    def execute(self, line: str) -> str | None:
        """Execute one line; return the answers to its queries, separated by semicolons, or None."""
        with self._lock:
            answers = [self._answer(command) for command in scpi.parse_commands(line)]
        return ";".join(answer for answer in answers if answer is not None) or None

    def _answer(self, command: scpi.ScpiCommand) -> str | None:
        for written, handler in self._handlers.items():
            if scpi.header_pattern(written).fullmatch(command.header):
                if len(command.arguments) != (not written.endswith("?")):
                    return None
                try:
                    return handler(*command.arguments)
                except InstrumentError:  # the argument is no number
                    return None
        return None

    def _shown(self, celsius: float) -> str:
        return f"{celsius if self.unit == 'C' else 32.0 + 1.8 * celsius:.2f}"

    def _set_unit(self, unit: str) -> None:
        if unit.upper() in ("C", "F"):
            self.unit = unit.upper()

    def _set_setpoint(self, number: str) -> None:
        value = parse_number(number)
        celsius = value if self.unit == "C" else (value - 32.0) / 1.8
        if LOWEST_C <= celsius <= HIGHEST_C and self.profile == "IDLE":
            self._chamber.set_setpoint(celsius)

    def _switch(self, state: str) -> None:
        on = state.upper() in ("ON", "1")
        if self._chamber.running() is not on:
            self._chamber.run(on)


class SimulatedWatlowF4TScpi(LineServer):
    """An F4T at `tcp://host:port`; `controller` provides what happens at the panel.

    Parameters
    ----------
    chamber
        The chamber.
    loop, on_by, on_number
        As for the driver: the loop of the air, and the output that switches conditioning; without one
        (`on_by = "nothing"`) it conditions from the start.
    """

    def __init__(self, chamber: ChamberMachine, *, loop: int = 1, on_by: str = "output", on_number: int = 1) -> None:
        self.controller = F4TController(chamber, loop=loop, on_number=on_number)
        if on_by == "nothing":
            chamber.run(True)
        super().__init__(self.controller.execute, over_tcp=True, end=b"\n")


Twin = SimulatedWatlowF4TScpi
