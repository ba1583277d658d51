"""A dialogue with one axis of an Ensemble: what it says to a line, taken apart. What the lines mean is the driver's."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.interfaces import Clock
from benchctl_instruments.links.byte_link import ByteLink
from benchctl_instruments.links.lines import LineDialogue, Manners
from benchctl_instruments.protocols.ensemble import END, Outcome, is_bare, is_reply, parse_reply
from benchctl_instruments.protocols.lines import MOST_SHOWN
from benchctl_instruments.rate_tables.axis_dialogue import AxisDialogue

Parsed = TypeVar("Parsed")


class EnsembleDialogue(AxisDialogue):
    """An `AxisDialogue` in which every line is answered.

    A command is said again too, since it sets something and does not change it by some amount: all but those told
    `once`.

    Parameters
    ----------
    link
        The link; the dialogue opens and closes it.
    axis
        The controller's number of the axis.
    timeout_s
        How long to wait for a connection, and for a reply; wall time.
    explain
        Asked after a refusal: why, in words.
    """

    def __init__(
        self, link: ByteLink, *, axis: int, timeout_s: float, clock: Clock, explain: Callable[[], str]
    ) -> None:
        manners = Manners(sent_end=END, answer_end=END, timeout_s=timeout_s)
        super().__init__(LineDialogue("rate table", link, manners=manners, clock=clock), axis=axis)
        self._explain = explain

    def say(self, command: str) -> None:
        """Send a command, whatever comes of it."""
        self._line.tell(self._text(command), repeatable=True)

    def tell(self, command: str, *values: float, once: bool = False) -> None:
        """Send a command, its `{}` filled with values; it must be acknowledged."""
        text = self._text(command, *values)
        line = self._line.tell(text, repeatable=not once)
        if not (once or is_reply(line)):
            line = self._line.tell(text)
        try:
            outcome = parse_reply(line).outcome
        except InstrumentError as err:
            raise InstrumentError(f"{self.who}: sent {text!r}, {err}; check that the address is an Ensemble's") from err
        if outcome is not Outcome.DONE:
            raise InstrumentError(
                f"{self.who}: sent {text!r}, expected %, got {line[:MOST_SHOWN]!r}; {self._reason(outcome)}"
            )

    def _ask_once(self, text: str, parse: Callable[[str], Parsed]) -> Parsed:
        line = self._line.ask(text, skip=is_bare)
        try:
            reply = parse_reply(line)
            if reply.outcome is not Outcome.DONE:
                raise InstrumentError(f"expected % and data, got {line[:MOST_SHOWN]!r}")
            return parse(reply.data)
        except InstrumentError as err:
            raise InstrumentError(
                f"{self.who}: asked {text!r}, {err}; check that the address is an Ensemble's, and the axis"
            ) from err

    def _reason(self, outcome: Outcome) -> str:
        if outcome is Outcome.NOT_UNDERSTOOD:
            return "it does not understand that; check the axis, the limits and the controller's version"
        if outcome is Outcome.NOT_IN_TIME:
            return "it did not finish in time; look at the controller, and begin again by enabling the table"
        return self._explain()
