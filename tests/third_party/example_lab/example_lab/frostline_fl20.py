"""The Frostline FL-20, a chamber that does not exist: lines of ASCII over TCP, CR LF behind each.

    ID?            FROSTLINE FL-20 1.03
    STAT?          T 23.41 S 25.00 P 12.5 RUN        air and set point in °C, power in percent, RUN or HALT
    S 25.00        OK                                a set point
    L -40.00 85.00 OK                                the limits of the set point
    RUN, HALT      OK                                conditioning on, off
    anything else  ERR and why

`FrostlineFL20` is the driver, `SimulatedFrostlineFL20` its twin over a machine of the simulated bench; they share the
protocol and nothing else.
"""

from __future__ import annotations

import re
from typing import Self

from benchctl_instruments.errors import BenchError, InstrumentError, UsageError
from benchctl_instruments.interfaces import ChamberReading, Clock, Identity
from benchctl_instruments.links.lines import LineDialogue, Manners
from benchctl_instruments.links.serial_port import byte_link
from benchctl_instruments.protocols.lines import LineCutter, encode_line
from benchctl_instruments.simulated.faults.wires import Lines
from benchctl_instruments.simulated.machines import ChamberMachine
from benchctl_instruments.simulated.tcp_server import TcpServer

_STATUS = re.compile(r"T (?P<air>-?\d+\.\d+) S (?P<setpoint>-?\d+\.\d+) P (?P<power>-?\d+\.\d+) (?P<mode>RUN|HALT)")


class FrostlineFL20:
    """A chamber behind an FL-20 at `tcp://HOST:PORT`; `timeout_s` of wall time is granted to an answer."""

    def __init__(self, address: str, *, clock: Clock, timeout_s: float = 1.0) -> None:
        manners = Manners(timeout_s=timeout_s)
        self._lines = LineDialogue("Frostline FL-20", byte_link(address), manners=manners, clock=clock)
        self._who = self._lines.who

    def open(self) -> None:
        """Connect and make sure that an FL-20 answers."""
        self._lines.open()
        try:
            self.identify()
        except BenchError:
            self.close()
            raise

    def close(self) -> None:
        """Let go of the link."""
        self._lines.close()

    def identify(self) -> Identity:
        """Name and program."""
        answer = self._lines.ask("ID?")
        maker, _, rest = answer.partition(" ")
        model, _, firmware = rest.partition(" ")
        if maker != "FROSTLINE" or not firmware:
            raise InstrumentError(f"{self._who}: asked ID?, expected FROSTLINE …, got {answer!r}; check the address")
        return Identity(manufacturer="Frostline", model=model, firmware=firmware)

    def set_limits(self, low_c: float, high_c: float) -> None:
        """The controller's own limits of the set point."""
        self._tell(f"L {low_c:.2f} {high_c:.2f}")

    def start(self) -> None:
        """Conditioning on."""
        self._tell("RUN")

    def stop(self) -> None:
        """Conditioning off."""
        self._tell("HALT")

    def go_to(self, setpoint_c: float) -> None:
        """A new set point, read back."""
        self._tell(f"S {setpoint_c:.2f}")
        shown_c = self.read().setpoint_c
        if abs(shown_c - setpoint_c) > 0.01:
            raise InstrumentError(f"{self._who}: was told set point {setpoint_c:.2f} °C, said OK, and shows {shown_c}")

    def read(self) -> ChamberReading:
        """Air, set point, power now."""
        answer = self._lines.ask("STAT?")
        match = _STATUS.fullmatch(answer)
        if match is None:
            raise InstrumentError(f"{self._who}: asked STAT?, expected T … S … P … RUN or HALT, got {answer!r}")
        return ChamberReading(
            temperature_c=float(match["air"]),
            setpoint_c=float(match["setpoint"]),
            power_percent=float(match["power"]),
        )

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _tell(self, command: str) -> None:
        answer = self._lines.tell(command, repeatable=True)
        if answer.startswith("ERR"):
            raise UsageError(f"{self._who}: {command!r} was refused: {answer}")
        if answer != "OK":
            raise InstrumentError(f"{self._who}: sent {command!r}, expected OK, got {answer!r}")


class SimulatedFrostlineFL20(TcpServer):
    """An FL-20 at `address` over a machine of the simulated bench."""

    wire = Lines(refusal_line=encode_line("ERR not now"))

    def __init__(self, chamber: ChamberMachine) -> None:
        super().__init__(self._connect)
        self._chamber = chamber
        self._limits_c = (-60.0, 150.0)

    def _connect(self) -> _Conversation:
        return _Conversation(self)

    def answer(self, line: str) -> str:
        """The line that answers a line."""
        match line.split():
            case ["ID?"]:
                return "FROSTLINE FL-20 1.03"
            case ["STAT?"]:
                mode = "RUN" if self._chamber.running() else "HALT"
                air_c, setpoint_c = self._chamber.air_c(), self._chamber.setpoint_c()
                return f"T {air_c:.2f} S {setpoint_c:.2f} P {self._chamber.power_percent():.1f} {mode}"
            case ["RUN" | "HALT" as mode]:
                self._chamber.run(mode == "RUN")
                return "OK"
            case ["S", number]:
                setpoint_c = float(number)
                if not self._limits_c[0] <= setpoint_c <= self._limits_c[1]:
                    return f"ERR outside {self._limits_c[0]:.2f} to {self._limits_c[1]:.2f}"
                self._chamber.set_setpoint(setpoint_c)
                return "OK"
            case ["L", low, high]:
                self._limits_c = (float(low), float(high))
                return "OK"
        return "ERR what?"


class _Conversation:
    """One client's connection."""

    def __init__(self, controller: SimulatedFrostlineFL20) -> None:
        self._controller = controller
        self._lines = LineCutter()

    def feed(self, data: bytes) -> bytes:
        """What answers the lines that are complete."""
        return b"".join(encode_line(self._answer(line)) for line in self._lines.feed(data))

    def _answer(self, line: str) -> str:
        try:
            return self._controller.answer(line)
        except ValueError:
            return "ERR no number"
