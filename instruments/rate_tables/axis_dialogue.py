"""What dialogues with one axis of a controller do alike: lines of text in which `{axis}` stands for the axis."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TypeVar

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.links.lines import LineDialogue
from benchctl_instruments.links.recovered import note_recovered

Parsed = TypeVar("Parsed")


class AxisDialogue(ABC):
    """Queries, and commands that are up to the controller; every exchange is safe from several threads.

    Junk in place of an answer is asked for once more, as silence is: `benchctl_instruments.links.lines` says how.

    Parameters
    ----------
    line
        The dialogue in lines; this one opens and closes it.
    axis
        The controller's number of the axis.
    """

    def __init__(self, line: LineDialogue, *, axis: int) -> None:
        self._line = line
        self._axis = axis
        self.who = line.who

    def open(self) -> None:
        """Connect; whether the right controller answers shows with the first question."""
        self._line.open()

    def close(self) -> None:
        """Let go of the link; safe to call twice, and never raises."""
        self._line.close()

    def ask(self, query: str, parse: Callable[[str], Parsed]) -> Parsed:
        """What `parse` makes of the answer to a query; it raises `InstrumentError` for what that cannot be."""
        text = self._text(query)
        try:
            return self._ask_once(text, parse)
        except InstrumentError as err:
            value = self._ask_once(text, parse)
            note_recovered(str(err))
            return value

    @abstractmethod
    def _ask_once(self, text: str, parse: Callable[[str], Parsed]) -> Parsed:
        """As `ask`, without a second try at what cannot be read."""

    def _text(self, pattern: str, *values: float) -> str:
        """A line, its `{}` filled with values."""
        return pattern.format(*(f"{value:.6f}" for value in values), axis=self._axis)
