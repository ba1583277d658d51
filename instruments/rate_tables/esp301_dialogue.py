"""A dialogue with one axis of an ESP301, its queue of errors included. What the lines mean is the driver's business."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TypeVar

from benchctl_instruments.errors import InstrumentError, LinkError
from benchctl_instruments.interfaces import Clock
from benchctl_instruments.links.byte_link import ByteLink
from benchctl_instruments.links.lines import LineDialogue, Manners
from benchctl_instruments.links.recovered import note_recovered
from benchctl_instruments.protocols.esp301 import ANSWER_END, SENT_END, Error, held_an_error, is_unasked, parse_error
from benchctl_instruments.protocols.lines import parse_number
from benchctl_instruments.rate_tables.axis_dialogue import AxisDialogue

Parsed = TypeVar("Parsed")

ASK_ERROR = "TE?"
MOST_ERRORS = 20  # more than the queue can hold


class Esp301Dialogue(AxisDialogue):
    """An `AxisDialogue` in which nothing but a query is answered.

    So the queue of errors is emptied after each command, and what is set is read back. An error leaves the queue when
    it is asked for, and its code may be lost on the line:

    | what comes for `TE?`                | what is done                                                         |
    |-------------------------------------|----------------------------------------------------------------------|
    | a 0 with junk                       | asked once more                                                      |
    | what cannot be read, and was no 0   | a fault, "an error whose code was lost on the line"; asked once more |
    | nothing in time                     | asked once more, and told that an error may have been lost           |

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
        self._counting = _CountingLine("rate table", link, manners=manners, clock=clock)
        super().__init__(self._counting, axis=axis)
        self._on_fault = on_fault

    def say(self, command: str) -> None:
        """Send a command and ask nothing."""
        self._line.tell(self._text(command))

    def tell(self, command: str, *values: float) -> None:
        """Send a command, its `{}` filled with values; no error may come of it."""
        text = self._text(command, *values)
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
                f"{self.who}: {self._text(setting)} should be {value:g}, it was not refused and reads back"
                f" {actual:g}; check the controller's own limits, and that nothing else commands it"
            )

    def take_errors(self) -> list[Error]:
        """Empty the queue."""
        errors: list[Error] = []
        for error in self._queued():
            errors.append(error)
            if error.fault:
                self._on_fault(error)
            if len(errors) > MOST_ERRORS:
                raise InstrumentError(
                    f"{self.who}: its queue of errors does not come to an end: {listed(errors)}; switch the controller"
                    " off and on"
                )
        return errors

    def _queued(self) -> Iterator[Error]:
        """What comes out of the queue, until it is empty."""
        while True:
            failures = self._counting.failures
            answer = self._line.ask(ASK_ERROR, skip=is_unasked)
            try:
                error = parse_error(answer)
            except InstrumentError as err:
                if held_an_error(answer):
                    yield Error(code=None)
                error = self._ask_once(ASK_ERROR, parse_error)
                note_recovered(f"{self.who}: asked {ASK_ERROR!r}, {err}")
            if self._counting.failures > failures:
                note_recovered(f"{self.who}: asked {ASK_ERROR!r} twice", "an error may have been lost on the line")
            if error is None:
                return
            yield error

    def _ask_once(self, text: str, parse: Callable[[str], Parsed]) -> Parsed:
        answer = self._line.ask(text, skip=is_unasked)
        try:
            return parse(answer)
        except InstrumentError as err:
            raise InstrumentError(f"{self.who}: asked {text!r}, {err}; check that the address is an ESP301's") from err


class _CountingLine(LineDialogue):
    """Counts what fails, be it got over by asking again: an answer that was lost is gone where asking takes it away."""

    failures = 0

    def _once(self, text: str, data: bytes, *, answered: bool, skip: Callable[[str], bool] | None) -> str:
        try:
            return super()._once(text, data, answered=answered, skip=skip)
        except LinkError:
            self.failures += 1
            raise


def listed(errors: list[Error]) -> str:
    """Errors in words, the oldest first."""
    return ", ".join(map(str, errors))
