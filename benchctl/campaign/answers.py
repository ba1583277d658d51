r"""An operator's answers, given beforehand in a file, so that a plan with steps by hand runs where nobody is.

A file of answers is TOML: each question in full, as `benchctl check` lists it, and its answer, `done` or `refuse`:

    "close the chamber's door" = "done"
    "switch the supply of unit SN-17 off" = "refuse"       # ends the run there, the bench brought to rest

A question that is asked several times has one answer. Answers to what is not asked do no harm.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from benchctl.campaign.hands import Hands, Meanwhile
from benchctl.campaign.questions import Question, mount_question, power_question
from benchctl.campaign.stop import StoppedError
from benchctl.closeness import nearest
from benchctl.documents import toml_document
from benchctl.limits import cut, shown
from benchctl.toml_file import read_text
from benchctl_instruments.errors import UsageError
from benchctl_instruments.mounting import Position

DONE, REFUSE = "done", "refuse"


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """The answers of a file, by question."""

    path: Path
    by_question: Mapping[str, str]

    def refuse_unanswered(self, asked: Iterable[Question]) -> None:
        """Raise `UsageError` where a question has no answer; it names all that have none, as the file would."""
        without = list(dict.fromkeys(one.says for one in asked if one.says not in self.by_question))
        if not without:
            return
        close = nearest(without[0], self.by_question)
        hint = f" (for the first there is only {shown(close)})" if close else ""
        lines = ", ".join(answer_line(says) for says in without)
        raise UsageError(
            f"answers {self.path}: {len(without)} of the plan's questions have no answer{hint}; add {lines}, a line "
            "each, or refuse in the place of done"
        )


class AnsweringHands:
    """Somebody who does what a file says is done; on a bench that is simulated in this process, `then` really do it.

    `StoppedError` where the file refuses.
    """

    def __init__(self, answers: Answers, unit: str, then: Hands | None) -> None:
        self.who = f"the answers of {answers.path}"
        self._by_question, self._unit, self._then = answers.by_question, unit, then

    def power(self, on: bool, meanwhile: Meanwhile) -> None:
        """Switch the unit's supply, or end the run."""
        self._answer(power_question(self._unit, on))
        if self._then is not None:
            self._then.power(on, meanwhile)

    def mount(self, position: Position, meanwhile: Meanwhile) -> None:
        """Mount the unit, or end the run."""
        self._answer(mount_question(self._unit, position))
        if self._then is not None:
            self._then.mount(position, meanwhile)

    def ask(self, says: str, meanwhile: Meanwhile) -> None:
        """Do what is asked, or end the run."""
        self._answer(says)
        if self._then is not None:
            self._then.ask(says, meanwhile)

    def _answer(self, says: str) -> None:
        if self._by_question.get(says) != DONE:
            raise StoppedError(f"stopped by {self.who}: refused to {says}")


def read_answers(path: Path) -> Answers:
    """The answers of a file.

    Raises
    ------
    UsageError
        Where it cannot be read, is no TOML, or holds another answer than done or refuse.
    """
    found = toml_document(read_text(path, "answers"), f"answers {path}")
    for says, answer in found.items():
        if answer not in (DONE, REFUSE):
            raise UsageError(f'answers {path}: {cut(says)}: expected "{DONE}" or "{REFUSE}", got {shown(answer)}')
    return Answers(path=path, by_question=found)


def answer_line(says: str) -> str:
    """A question as a line of a file that says that it is done."""
    return f'{json.dumps(says, ensure_ascii=False)} = "{DONE}"'
