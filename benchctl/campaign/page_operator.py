"""An operator at the live page: questions and answers are files in the campaign's folder, as a stop request is.

The run writes the question, a process that has only the folder writes the answer:

```
question.json   {"id": "5f0c…", "text": "close the chamber's door"}
answer.json     {"id": "5f0c…", "answer": "done", "who": "A. Ivanova"}
```

An answer counts only for the question with its id. Both files are removed once the question is answered, or the run
ends, and no manifest lists them.
"""

from __future__ import annotations

import json
import secrets
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchctl.atomic import whole_file
from benchctl.campaign.operator import DONE, REFUSE, Answering, Meanwhile, Operator
from benchctl.campaign.stop import StoppedError, require_run
from benchctl.documents import read_json
from benchctl.limits import cut
from benchctl.recordings.schema import ANSWER, QUESTION
from benchctl_instruments.errors import UsageError

_LOOK_EVERY_S = 0.1
"""Wall time between two looks for the answer; the clock of a simulated bench does not wait."""
_LONGEST_TEXT = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenQuestion:
    """A question of a run that waits for its answer."""

    id: str
    text: str


class NotAskedError(UsageError):
    """The question is not open, or no more."""


class PageOperator(Answering):
    """An operator who answers at the live page; `who` started the run there, later it is who answered last."""

    def __init__(self, folder: Path, who: str, unit: str, then: Operator | None) -> None:
        super().__init__(_at_page(who), unit, then)
        self._folder = folder

    def _answer(self, text: str, meanwhile: Meanwhile) -> None:
        question = OpenQuestion(id=secrets.token_hex(8), text=text)
        forget_question(self._folder)
        _write(self._folder / QUESTION, asdict(question))
        try:
            while (answer := _answer_to(question, self._folder)) is None:
                meanwhile()
                time.sleep(_LOOK_EVERY_S)
        finally:
            forget_question(self._folder)
        self.who = _at_page(str(answer.get("who", "")))
        if answer.get("answer") != DONE:
            raise StoppedError(f"stopped by {self.who}: refused to {text}")


def open_question(folder: Path) -> OpenQuestion | None:
    """Return the question that the run in this folder waits for; None if there is none."""
    found = _read(folder / QUESTION, "question")
    if found is None:
        return None
    return OpenQuestion(**{name: cut(str(found.get(name, "")), _LONGEST_TEXT) for name in ("id", "text")})


def answer_question(folder: Path, question_id: str, *, done: bool, who: str) -> None:
    """Answer the open question of a run, or refuse what it demands, which ends the run safely.

    Raises
    ------
    NotRunningError
        No run holds the campaign's lock.
    NotAskedError
        Another question is open, or none, or it has an answer already.
    UsageError
        The folder is not writable.
    """
    require_run(folder)
    question = open_question(folder)
    if question is None or question.id != question_id or (folder / ANSWER).exists():
        raise NotAskedError(
            f"campaign {folder.name}: this question is answered already, or the run has gone on; "
            "answer the one that it asks now"
        )
    _write(folder / ANSWER, {"id": question_id, "answer": DONE if done else REFUSE, "who": who})


def forget_question(folder: Path) -> None:
    """Remove an open question and its answer."""
    for name in (QUESTION, ANSWER):
        with suppress(OSError):
            (folder / name).unlink()


def _at_page(who: str) -> str:
    return f"{cut(who, 60) or 'somebody'}, at the live page"


def _answer_to(question: OpenQuestion, folder: Path) -> dict[str, Any] | None:
    found = _read(folder / ANSWER, "answer")
    return found if found is not None and found.get("id") == question.id else None


def _write(path: Path, content: dict[str, Any]) -> None:
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(content, ensure_ascii=False), encoding="utf-8")


def _read(path: Path, what: str) -> dict[str, Any] | None:
    """Return the content of a file; None if it is not there, or is none of ours."""
    try:
        found = read_json(path, what) if path.exists() else None
    except UsageError:
        return None
    return found if isinstance(found, dict) else None
