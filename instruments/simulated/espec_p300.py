"""A simulated chamber with an ESPEC P-300 controller. It shares only the command language with the driver.

Behaviour chosen without a source: while a program runs, or the panel is off, settings are refused with CHB NOT READY,
except that MODE,STANDBY and MODE,OFF end a program and POWER,ON switches the panel on. Alarms that would exclude the
set point are refused, and so are alarms beyond the chamber's own range. Air beyond an alarm while the chamber
conditions latches an alarm with our own code, and conditioning continues. There is no control of humidity or of a
product's temperature, no timer, and no program except the one that is started manually at the panel; the date and the
time are constant at the last values set.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Callable

from benchctl_instruments.protocols import p300
from benchctl_instruments.protocols.lines import encode_line
from benchctl_instruments.protocols.p300 import data_line
from benchctl_instruments.simulated.faults.wires import Lines, Wire
from benchctl_instruments.simulated.machines import ChamberMachine
from benchctl_instruments.simulated.serial_line import LineServer

LOWEST_C, HIGHEST_C = -75.0, 180.0
BEYOND_HIGH, BEYOND_LOW = 1, 2  # our own codes: there is no public list of the real ones
RELAYS = 12
PAUSED = " PAUSE"
ROM = "P300 SIMULATED 1.00"
SETTINGS = {  # values that are only stored: their form in a command, and their initial value
    "DATE": (r"(\d{1,2}\.\d{1,2}/\d{1,2})\. ?[A-Z]{3}", "26.1/1"),
    "TIME": (r"(\d{1,2}:\d{1,2}:\d{1,2})", "12:0:0"),
    "MASK": ("([01]{8})", "00000000"),
    "KEYPROTECT": ("(ON|OFF)", "OFF"),
    "SET": ("(REF[01369])", "REF9"),
}
REFRIGERATION = {"REF0": "OFF", "REF1": "20", "REF3": "50", "REF6": "100", "REF9": "AUTO"}
ALWAYS = {  # queries with a constant answer
    "ROM": ROM,
    "ROM,DISP": ROM,
    "TYPE": f"T,P300,{HIGHEST_C}",
    "TIMER ON": "0",
    "TIMER USE": "0",
    "PRGM USE,RAM": "0",
    "SYSTEM SET,PTCOPT": "OFF",
}
REFUSED = {  # commands and queries of a real one for functions that are not simulated
    **dict.fromkeys(("HUMI", "MON PTC", "TEMP PTC", "SET PTC", "PTC", "PRGM DATA PTC"), "CONT NOT READY-1"),
    **dict.fromkeys(("CONSTANT SET,HUMI", "CONSTANT SET,PTC"), "CONT NOT READY-1"),
    **dict.fromkeys(("RUN PRGM", "RUN PRGM MON"), "CONT NOT READY-3"),
    **dict.fromkeys(("PRGM USE", "PRGM DATA", "PRGM ERASE", "TIMER LIST", "TIMER"), "DATA NOT READY"),
    "PRGM DATA WRITE": "PRGM WRITE ERR-1",
    "TIMER WRITE": "INVALID REQ",
    "TIMER ERASE": "INVALID REQ",
}


class _RefusedError(Exception):
    """The text after the NA."""


class P300Controller:
    """The controller's states over a `ChamberMachine`, without I/O. Thread-safe.

    Parameters
    ----------
    chamber
        The chamber machine.
    rs485_address
        Its number on RS-485, where it answers only lines that begin with it; None: it is not on RS-485.

    `protected` is a switch on its panel.
    """

    def __init__(self, chamber: ChamberMachine, *, rs485_address: int | None = None) -> None:
        self._chamber = chamber
        self._rs485_address = rs485_address
        self._lock = threading.Lock()
        self._mode = p300.CONSTANT if chamber.running() else p300.STANDBY
        self._low_c, self._high_c = LOWEST_C, HIGHEST_C
        self._alarms: list[int] = []
        self._relays: set[int] = set()
        self.protected = False
        self._settings = {name: first for name, (_, first) in SETTINGS.items()}
        self._queries: dict[str, Callable[[], str]] = {
            **{name: lambda text=text: text for name, text in ALWAYS.items()},  # type: ignore[misc]
            **{name: lambda name=name: self._settings[name] for name in SETTINGS},  # type: ignore[misc]
            "TEMP": lambda: data_line(chamber.air_c(), chamber.setpoint_c(), self._high_c, self._low_c),
            "CONSTANT SET,TEMP": lambda: data_line(chamber.setpoint_c(), "ON"),
            "CONSTANT SET,REF": lambda: REFRIGERATION[self._settings["SET"]],
            "CONSTANT SET,RELAY": self._relays_on,
            "MON": lambda: data_line(chamber.air_c(), None, self._short_mode(), len(self._alarms)),
            "MON,DETAIL": lambda: data_line(chamber.air_c(), None, self._mode, len(self._alarms)),
            "MODE": self._short_mode,
            "MODE,DETAIL": lambda: self._mode,
            "ALARM": lambda: data_line(len(self._alarms), *self._alarms),
            "SRQ": lambda: f"0{int(bool(self._alarms))}000000",
            "%": lambda: data_line(1, max(0.0, chamber.power_percent())),
            "RELAY": self._relays_on,
            "REF": lambda: "2,ON1,ON2" if self._conditions() else "2,OFF1,OFF2",
            "PRGM MON": lambda: self._of_program(data_line(1, chamber.setpoint_c(), "0:00", 0, 0)),
            "PRGM SET": lambda: self._of_program("RAM:1,PANEL,END(STANDBY)"),
        }
        self._commands: dict[str, Callable[[tuple[str, ...]], object]] = {
            "TEMP": self._set_temperatures,
            "MODE": self._set_mode,
            "POWER": self._set_power,
            "RELAY": self._set_relays,
            "PRGM": self._program,
            "SRQ": self._reset_srq,
        }

    def run_program(self, mode: str = p300.RUN) -> None:
        """Start a program, as at the panel; `mode` is one of `DETAILED_MODES` with RUN in it."""
        with self._lock:
            self._enter(mode)

    def raise_alarm(self, code: int) -> None:
        """Latch an alarm of the chamber itself."""
        with self._lock:
            self._latch(code)

    def clear_alarms(self) -> None:
        """Clear all alarms, as at the panel; those whose cause persists come back."""
        with self._lock:
            self._alarms.clear()

    def execute(self, line: str) -> str | None:
        """Execute one line; return the answer, or None if the line is for another chamber on the bus."""
        request = p300.parse_request(line)
        if self._rs485_address is not None and request.address != self._rs485_address:
            return None
        with self._lock:
            self._look_at_air()
            try:
                if self._rs485_address is None and request.address is not None:
                    raise _RefusedError("ADDR ERR")
                if request.query:
                    return self._answer(request.name, request.parameters)
                self._obey(request.name, request.parameters)
            except _RefusedError as refused:
                return f"NA:{refused}"
        return f"OK:{','.join((request.name, *request.parameters))}"

    # Queries and commands ---------------------------------------------------------------------------------------------

    def _answer(self, name: str, parameters: tuple[str, ...]) -> str:
        query = ",".join((name, *parameters))
        if query in self._queries:
            return self._queries[query]()
        if refusal := REFUSED.get(query, REFUSED.get(name)):
            raise _RefusedError(refusal)
        known = any(each.partition(",")[0] == name for each in self._queries)
        raise _RefusedError("PARA ERR" if known else "CMD ERR")

    def _obey(self, name: str, parameters: tuple[str, ...]) -> None:
        if name not in self._commands and name not in SETTINGS:
            raise _RefusedError(REFUSED.get(name, "CMD ERR"))
        if self.protected:
            raise _RefusedError("PROTECT ON")
        if name in self._commands:
            self._commands[name](parameters)
        elif found := re.fullmatch(SETTINGS[name][0], ",".join(parameters)):
            self._settings[name] = found[1]
        else:
            raise _RefusedError("PARA ERR")

    def _set_temperatures(self, parameters: tuple[str, ...]) -> None:
        settings = p300.parse_settings(parameters)
        if settings is None:
            raise _RefusedError("PARA ERR")
        self._refuse_unless_ready()
        setpoint_c = settings.get("S", p300.tenths(self._chamber.setpoint_c()))
        high_c, low_c = settings.get("H", self._high_c), settings.get("L", self._low_c)
        if not LOWEST_C <= low_c <= setpoint_c <= high_c <= HIGHEST_C or low_c == high_c:
            raise _RefusedError("DATA OUT OF RANGE")
        self._high_c, self._low_c = p300.tenths(high_c), p300.tenths(low_c)
        if "S" in settings:
            self._chamber.set_setpoint(p300.tenths(setpoint_c))

    def _set_mode(self, parameters: tuple[str, ...]) -> None:
        match parameters:
            case (p300.OFF | p300.STANDBY as mode,):
                if self._mode == p300.OFF:
                    raise _RefusedError("CHB NOT READY")
                self._enter(mode)
            case (p300.CONSTANT,):
                self._refuse_unless_ready()
                self._enter(p300.CONSTANT)
            case (str(program),) if program.startswith(p300.RUN):
                raise _RefusedError("DATA NOT READY")
            case _:
                raise _RefusedError("PARA ERR")

    def _set_power(self, parameters: tuple[str, ...]) -> None:
        if parameters not in (("ON",), ("OFF",)):
            raise _RefusedError("PARA ERR")
        if parameters == ("OFF",):
            self._enter(p300.OFF)
        elif p300.RUN not in self._mode:
            self._enter(p300.CONSTANT)

    def _set_relays(self, parameters: tuple[str, ...]) -> None:
        switch, numbers = parameters[:1], parameters[1:]
        known = {str(number): number for number in range(1, RELAYS + 1)}
        if switch not in (("ON",), ("OFF",)) or not numbers or not known.keys() >= set(numbers):
            raise _RefusedError("PARA ERR")
        self._refuse_unless_ready()
        chosen = {known[number] for number in numbers}
        self._relays = self._relays | chosen if switch == ("ON",) else self._relays - chosen

    def _program(self, parameters: tuple[str, ...]) -> None:
        ends = {"HOLD": p300.CONSTANT, "CONST": p300.CONSTANT, "STANDBY": p300.STANDBY, "OFF": p300.OFF}
        match parameters:
            case ("RUN", _, _):
                raise _RefusedError("DATA NOT READY")
            case ("END", end) if end in ends:
                self._enter(self._of_program(ends[end]))
            case ("PAUSE" | "CONTINUE" | "ADVANCE" as order,):
                running = self._of_program(self._mode.removesuffix(PAUSED))
                self._enter(running + PAUSED if order == "PAUSE" else running)
            case _:
                raise _RefusedError("PARA ERR")

    def _of_program(self, text: str) -> str:
        """Return the text if a program is running; otherwise refuse."""
        if p300.RUN not in self._mode:
            raise _RefusedError("CONT NOT READY-2")
        return text

    def _relays_on(self) -> str:
        return data_line(len(self._relays), *sorted(self._relays))

    def _reset_srq(self, parameters: tuple[str, ...]) -> None:
        if parameters != ("RESET",):
            raise _RefusedError("PARA ERR")

    # States -----------------------------------------------------------------------------------------------------------

    def _short_mode(self) -> str:
        return p300.RUN if p300.RUN in self._mode else self._mode

    def _conditions(self) -> bool:
        return self._mode not in (p300.OFF, p300.STANDBY)

    def _refuse_unless_ready(self) -> None:
        if self._mode not in (p300.STANDBY, p300.CONSTANT):
            raise _RefusedError("CHB NOT READY")

    def _enter(self, mode: str) -> None:
        self._mode = mode
        if self._chamber.running() is not self._conditions():
            self._chamber.run(self._conditions())

    def _look_at_air(self) -> None:
        air_c = p300.tenths(self._chamber.air_c())
        if self._conditions() and air_c > self._high_c:
            self._latch(BEYOND_HIGH)
        if self._conditions() and air_c < self._low_c:
            self._latch(BEYOND_LOW)

    def _latch(self, code: int) -> None:
        if code not in self._alarms:
            self._alarms.append(code)


class SimulatedEspecP300(LineServer):
    """A chamber with a P-300 at `tcp://host:port`, or on a serial line; a driver uses its `address`.

    Both carry the same lines.

    Parameters
    ----------
    chamber
        The chamber machine.
    rs485_address
        Its number on RS-485; None: it is not on RS-485.
    over_tcp
        Serve at a serial-to-Ethernet box, to several clients at once; otherwise on a serial line at 9600 baud, see
        `SerialLine`.
    pace_baud
        Simulated speed of the line; None: no delay.

    `controller` provides the manual actions at the panel.
    """

    wire: Wire = Lines(refusal_line=encode_line("NA:CHB NOT READY"))

    def __init__(
        self,
        chamber: ChamberMachine,
        *,
        rs485_address: int | None = None,
        over_tcp: bool = True,
        pace_baud: int | None = None,
    ) -> None:
        self.controller = P300Controller(chamber, rs485_address=rs485_address)
        super().__init__(self.controller.execute, over_tcp=over_tcp, pace_baud=pace_baud)


Twin = SimulatedEspecP300
