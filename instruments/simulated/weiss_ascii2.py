"""A simulated Weiss or Vötsch chamber with ASCII-2. It shares only the texts of values and requests with the driver.

Its strings are those of a Vc3 7060 as one described itself: temperature, humidity, fan, four measured values. Behaviour
chosen without a source: shorter strings, as some clients send them, change what they contain, and a string without
channels switches them off (ondrejh/VT4002); anything else that is wrong is not answered. A request for another address
is not answered. Humidity and fan are stored.
"""

from __future__ import annotations

import re
import threading

from benchctl_instruments.protocols import ascii2
from benchctl_instruments.simulated.machines import ChamberMachine
from benchctl_instruments.simulated.serial_line import LineServer

LOWEST_C, HIGHEST_C = -75.0, 180.0
CHANNELS = 32
SET_NAMES = ("CV01", "CV02", "SV01", "MV01", "MV02", "MV03", "MV04")
CHANNEL_NAMES = {1: "Start", 2: "Humidity", 7: "Cond.protect", 11: "Dryer"}


class Ascii2Controller:
    """The chamber's states over a `ChamberMachine`, without I/O. Thread-safe.

    Parameters
    ----------
    chamber
        The chamber machine.
    unit_id
        Its address.
    """

    def __init__(self, chamber: ChamberMachine, *, unit_id: int = 1) -> None:
        self._chamber = chamber
        self._unit_id = unit_id
        self._lock = threading.Lock()
        self._values = [0.0, 50.0, 50.0, 0.0, 0.0, 0.0, 0.0]  # the first is the machine's
        self._channels = "0" * CHANNELS

    def stop_by_itself(self) -> None:
        """Stop, as after a fault."""
        self._chamber.run(False)

    def execute(self, line: str) -> str | None:
        """Execute one request; return the answer, or None."""
        found = re.fullmatch(r"\$([0-9]{2})([IE?])((?: +\S+)*) *", line)
        if found is None or int(found[1]) != self._unit_id:
            return None
        fields = found[3].split()
        with self._lock:
            if found[2] == "E":
                return self._write(fields)
            if fields:
                return None
            return self._state() if found[2] == "I" else self._description()

    def _state(self) -> str:
        humidity, fan = self._values[1:3]
        measured = [value for sensor in (23.8, 22.2, 25.5, 24.4) for value in (0.0, sensor)]
        values = (self._chamber.setpoint_c(), self._chamber.air_c(), humidity, 66.7, fan, fan, *measured)
        running = str(int(self._chamber.running()))
        channels = self._channels[: ascii2.START] + running + self._channels[ascii2.START + 1 :]
        return " ".join((*map(ascii2.value_text, values), channels))

    def _write(self, fields: list[str]) -> str | None:
        channels = fields.pop() if fields and re.fullmatch("[01]{2,32}", fields[-1]) else ""
        if not fields or not all(re.fullmatch(r"-?[0-9]{1,4}(\.[0-9]{1,6})?", field) for field in fields):
            return None
        setpoint_c, *others = map(float, fields)
        if not LOWEST_C <= setpoint_c <= HIGHEST_C:
            return None
        self._chamber.set_setpoint(setpoint_c)
        others = others[: len(SET_NAMES) - 1]
        self._values[1 : 1 + len(others)] = others
        self._channels = channels.ljust(CHANNELS, "0")
        if self._chamber.running() is not (start := self._channels[ascii2.START] == "1"):
            self._chamber.run(start)
        return ascii2.ACCEPTED

    def _description(self) -> str:
        digital = " ".join(f"DO{number:02d}" for number in range(CHANNELS))
        state_names = " ".join(f"{name} {name}" for name in SET_NAMES)
        channels = (f"DO{number:02d}  {CHANNEL_NAMES.get(number, 'unused')}" for number in range(CHANNELS))
        return "\r\n".join(
            (
                "ASCII-2 PROTOCOL CONFIGURATION",
                "Example of an ASCII E-String:",
                f"${self._unit_id:02d}E {' '.join(SET_NAMES)} {digital} <CR>",
                "Description:",
                f"CV01  value min:  {LOWEST_C:.1f}   value max:  {HIGHEST_C:.1f}   Temperature",
                "CV02  value min:    0.0   value max:  100.0   Humidity",
                "SV01  value min:   50.0   value max:  100.0   Fan speed",
                *channels,
                "-" * 80,
                "Example of an ASCII I-String:",
                f"${self._unit_id:02d}I<CR>",
                f"{state_names} {digital} <CR>",
                "Configured Messages:",
                "none",
            )
        )


class SimulatedWeissAscii2(LineServer):
    """A chamber with ASCII-2 on a serial line, or at `tcp://host:port`; a driver uses its `address`.

    Parameters
    ----------
    chamber
        The chamber machine.
    unit_id
        Its address.
    over_tcp, pace_baud
        As for `LineServer`.

    `controller` provides what happens at the chamber.
    """

    def __init__(
        self, chamber: ChamberMachine, *, unit_id: int = 1, over_tcp: bool = False, pace_baud: int | None = None
    ) -> None:
        self.controller = Ascii2Controller(chamber, unit_id=unit_id)
        super().__init__(self.controller.execute, over_tcp=over_tcp, pace_baud=pace_baud)


Twin = SimulatedWeissAscii2
