"""A dialogue with one axis of an ESP301, its queue of errors included. What the lines mean is the driver's business."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

from instruments.errors import InstrumentError
from instruments.interfaces import Clock
from instruments.links.byte_link import ByteLink
from instruments.links.lines import LineDialogue, Manners
from instruments.links.recovered import note_recovered
from instruments.protocols.esp301 import ANSWER_END, SENT_END, Error, is_unasked, parse_error, parse_number

Parsed = TypeVar("Parsed")

ASK_ERROR = "TE?"
MOST_ERRORS = 20  # more than the queue can hold


class Esp301Dialogue:
    """Queries and commands in which `{axis}` stands for the axis; every exchange is safe from several threads.

    Nothing but a query is answered, so the queue is emptied after each command, and what is set is read back. Junk in
    place of an answer is asked for once more, as silence is: `instruments.links.lines` says how. An error that was
    taken out of the queue and lost on the line is lost.

    Parameters
    ----------
    link
        The link; the dialogue opens and closes it.
    axis
        The controller's number of the axis.
    timeout_s
        How long to wait for a whole answer; wall time.
    on_fault
        Told of each fault that comes out of the queue.
    """

    def __init__(
        self, link: ByteLink, *, axis: int, timeout_s: float, clock: Clock, on_fault: Callable[[Error], None]
    ) -> None:
        manners = Manners(sent_end=SENT_END, answer_end=ANSWER_END, timeout_s=timeout_s, commands_answered=False)
        self._line = LineDialogue("rate table", link, manners=manners, clock=clock)
        self._axis = axis
        self._on_fault = on_fault
        self.who = self._line.who

    def open(self) -> None:
        """Connect; whether an ESP301 answers shows with the first question."""
        self._line.open()

    def close(self) -> None:
        """Let go of the link; safe to call twice, and never raises."""
        self._line.close()

    def ask(self, query: str, parse: Callable[[str], Parsed]) -> Parsed:
        """What `parse` makes of the answer to a query; it raises `InstrumentError` for what that cannot be."""
        text = query.format(axis=self._axis)
        try:
            return self._ask_once(text, parse)
        except InstrumentError as err:
            value = self._ask_once(text, parse)
            note_recovered(str(err))
            return value

    def say(self, command: str) -> None:
        """Send a command and ask nothing."""
        self._line.tell(command.format(axis=self._axis))

    def tell(self, command: str, *values: float) -> None:
        """Send a command, its `{}` filled with values; no error may come of it."""
        text = command.format(*(f"{value:.6f}" for value in values), axis=self._axis)
        self._line.tell(text)
        if errors := self.take_errors():
            raise InstrumentError(
                f"{self.who}: sent {text!r}, it reports {listed(errors)}; remove the cause, then enable the table again"
            )

    def write(self, setting: str, value: float) -> None:
        """Set a value and read it back."""
        self.tell(f"{setting}{{}}", value)
        actual = self.ask(f"{setting}?", parse_number)
        if not math.isclose(actual, value, rel_tol=1e-3, abs_tol=1e-3):
            raise InstrumentError(
                f"{self.who}: {setting.format(axis=self._axis)} should be {value:g}, it was not refused and reads back"
                f" {actual:g}; check the controller's own limits, and that nothing else commands it"
            )

    def take_errors(self) -> list[Error]:
        """Empty the queue."""
        errors: list[Error] = []
        while error := self.ask(ASK_ERROR, parse_error):
            errors.append(error)
            if error.fault:
                self._on_fault(error)
            if len(errors) > MOST_ERRORS:
                raise InstrumentError(
                    f"{self.who}: its queue of errors does not come to an end: {listed(errors)}; switch the controller"
                    " off and on"
                )
        return errors

    def _ask_once(self, text: str, parse: Callable[[str], Parsed]) -> Parsed:
        answer = self._line.ask(text, skip=is_unasked)
        try:
            return parse(answer)
        except InstrumentError as err:
            raise InstrumentError(f"{self.who}: asked {text!r}, {err}; check that the address is an ESP301's") from err


def listed(errors: list[Error]) -> str:
    """Errors in words, the oldest first."""
    return ", ".join(map(str, errors))
