"""What the drivers of Thermotron's controllers have in common; `thermotron_8800` and `thermotron_3800` name the models.

The driver controls temperature only, channel 1, which must be set to °C: the public sources do not say how to ask for
the unit. There are no commands for set point limits, so the driver keeps those of the bench. A set point that is sent
while the controller is stopped is confirmed at `start`.

Fault handling: as in `line_chamber`. A set point or state that is not kept raises `InstrumentError`. A chamber that
stopped by itself is an alarm. A single reading does not show air that is stuck or stalls short of the set point; a soak
that does not end shows it.
"""

from __future__ import annotations

from abc import abstractmethod
from functools import partial
from typing import ClassVar

from benchctl_instruments.chambers.line_chamber import SETPOINT, KeptLimitsChamber
from benchctl_instruments.interfaces import Clock
from benchctl_instruments.links.lines import LineDialogue, Manners
from benchctl_instruments.links.serial_port import byte_link
from benchctl_instruments.links.tcp import Reconnect
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.protocols import thermotron
from benchctl_instruments.protocols.lines import parse_number
from benchctl_instruments.recognition import ByLine

BAUD = 9600


def recognition_of(model: str) -> tuple[ByLine, ...]:
    """Return how a controller is recognised: by its name."""
    return (
        ByLine(query=thermotron.IDENTITY, read=partial(thermotron.read_name, model=model), answer_end=None, baud=BAUD),
    )


class Thermotron(KeptLimitsChamber):
    """Driver of a Thermotron controller. Not tried on hardware. Thread-safe.

    Parameters
    ----------
    address
        `tcp://HOST:PORT`, `serial://DEVICE?baud=9600` (or as set on the controller) or `socket://HOST:PORT`.
    clock, timeout_s, wire_log
        See `LineChamber`.
    reconnect
        See `byte_link`.
    """

    NAME: ClassVar[str]
    COMMANDS_ANSWERED: ClassVar[bool]

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        timeout_s: float = 3.0,
        reconnect: Reconnect | None = None,
        wire_log: WireLog | None = None,
    ) -> None:
        lines = LineDialogue(
            self.NAME,
            byte_link(address, default_baud=BAUD, reconnect=reconnect, wire_log=wire_log),
            manners=Manners(answer_end=None, timeout_s=timeout_s, commands_answered=self.COMMANDS_ANSWERED),
            clock=clock,
        )
        super().__init__(lines, clock=clock, controller=f"a {self.NAME}")
        self._wanted_c: float | None = None  # the last set point that this driver sent

    def stop(self) -> None:
        """Stop, whatever it runs. The set point does not change."""
        self._tell(thermotron.STOP)
        self._confirm_running(on=False)
        self._switched_on = False

    def _confirm_running(self, *, on: bool) -> None:
        self._confirm(_running_words(on=on), lambda: _running_words(on=self._runs()))

    def _send_setpoint(self) -> None:
        if self._wanted_c is not None:
            self._tell(thermotron.set_value(thermotron.SETPOINT, self._wanted_c))

    def _confirm_setpoint(self) -> None:
        if self._wanted_c is not None:
            self._confirm_number(SETPOINT, self._wanted_c, self._setpoint_c)

    def _air_c(self) -> float:
        return self._ask(thermotron.AIR, parse_number)

    def _setpoint_c(self) -> float:
        return self._ask(thermotron.query(thermotron.SETPOINT), parse_number)

    @abstractmethod
    def _runs(self) -> bool: ...

    @abstractmethod
    def _tell(self, command: str) -> None: ...


def _running_words(*, on: bool) -> str:
    return "manual mode" if on else "stopped"
