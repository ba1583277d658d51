"""An operator at the live page: questions and answers by files in the campaign's folder."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from benchctl.app.run import Watch, play
from benchctl.campaign.opened import open_bench
from benchctl.campaign.page_operator import (
    NotAskedError,
    OpenQuestion,
    PageOperator,
    answer_question,
    forget_question,
    open_question,
)
from benchctl.campaign.runner import Outcome, run_campaign
from benchctl.campaign.stop import NotRunningError
from benchctl.plan import Ask
from benchctl.recordings.campaign_folder import campaign_lock
from benchctl.recordings.campaign_manifest import problems_of_folder, write_manifest
from benchctl.recordings.schema import ANSWER, QUESTION
from benchctl_instruments.errors import UsageError
from tests.benchctl.campaign.by_hand import ACROSS, BENCH, REST, events, plan_of

DOOR = "close the chamber's door"
PLAN = plan_of(Ask(says=DOOR), ACROSS, REST)


def run(folder: Path, answer: Callable[[OpenQuestion], None]) -> Outcome:
    """Run the plan for A. Ohm; each question is handed to `answer` once, in another thread."""
    over = threading.Event()

    def at_the_page() -> None:
        seen = ""
        while not over.wait(0.02):
            if (question := open_question(folder)) is not None and question.id != seen:
                seen = question.id
                answer(question)

    page = threading.Thread(target=at_the_page)
    page.start()
    try:
        with open_bench(BENCH, wires=False) as opened:
            operator = PageOperator(folder, "A. Ohm", "U-1", opened.operator)
            return run_campaign(PLAN, replace(opened, operator=operator), folder)
    finally:
        over.set()
        page.join()


def test_a_run_asks_at_the_page_and_its_journal_names_who_began_it_and_who_answered(tmp_path: Path) -> None:
    folder, asked = tmp_path / "c", list[str]()

    def answer(question: OpenQuestion) -> None:
        asked.append(question.text)
        answer_question(folder, question.id, done=True, who="B. Volt")
        if len(asked) == 1:
            with pytest.raises(NotAskedError, match="answered already, or the run has gone on"):
                answer_question(folder, question.id, done=False, who="B. Volt")

    assert run(folder, answer).status == "complete"
    mount = "mount unit U-1 with its input axis across the table's axis, then stand clear of the table"
    assert asked == [DOOR, mount]
    assert [event["by"] for event in events(folder, "started")] == ["A. Ohm, at the live page"]
    assert [event["by"] for event in events(folder, "operator")] == ["B. Volt, at the live page"] * 2
    assert not (folder / QUESTION).exists()
    assert not (folder / ANSWER).exists()


def test_a_refusal_ends_the_run_at_rest(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    outcome = run(folder, lambda question: answer_question(folder, question.id, done=False, who="B. Volt"))
    assert outcome.status == "interrupted"
    assert str(outcome.error) == f"stopped by B. Volt, at the live page: refused to {DOOR}"
    assert outcome.safe.confirmed
    assert open_question(folder) is None


def test_an_answer_to_another_question_or_to_nobody_is_refused_and_not_written(tmp_path: Path) -> None:
    (tmp_path / QUESTION).write_text('{"id": "now", "text": "close the door"}')
    with pytest.raises(NotRunningError):
        answer_question(tmp_path, "now", done=True, who="B. Volt")
    lock = campaign_lock(tmp_path)
    lock.acquire("recording")
    with pytest.raises(NotAskedError):
        answer_question(tmp_path, "before", done=True, who="B. Volt")
    forget_question(tmp_path)
    with pytest.raises(NotAskedError):
        answer_question(tmp_path, "now", done=True, who="B. Volt")
    lock.release()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", [b"", b"[]", b'{"id": "another", "answer": "done"}', b"\xff\xfe", b"[" * 5000])
def test_what_is_no_answer_to_the_question_is_waited_past(tmp_path: Path, content: bytes) -> None:
    folder = tmp_path / "c"

    def answer(question: OpenQuestion) -> None:
        (folder / ANSWER).write_bytes(content)
        time.sleep(0.3)
        assert open_question(folder) == question
        (folder / ANSWER).unlink()
        answer_question(folder, question.id, done=False, who="B. Volt")

    assert run(folder, answer).status == "interrupted"


@pytest.mark.parametrize("content", [b"", b"[]", b"\xff\xfe", b"[" * 5000])
def test_what_is_no_question_is_none(tmp_path: Path, content: bytes) -> None:
    (tmp_path / QUESTION).write_bytes(content)
    assert open_question(tmp_path) is None


def test_what_a_killed_run_has_left_is_in_no_manifest(tmp_path: Path) -> None:
    (tmp_path / "recording.h5").write_bytes(b"x")
    for name in (QUESTION, ANSWER):
        (tmp_path / name).write_text("{}")
    write_manifest(tmp_path)
    forget_question(tmp_path)
    assert list(problems_of_folder(tmp_path)) == []


def test_a_table_that_is_turned_by_hand_needs_its_operator_beside_it(tmp_path: Path) -> None:
    by_hand = BENCH.rate_table.model_copy(update={"model": "manual"})
    bench = BENCH.model_copy(update={"rate_table": by_hand})
    with pytest.raises(UsageError, match="turned by hand; run it at a terminal"):
        play(plan_of(REST), bench, tmp_path / "c", watch=Watch(warn=lambda text: None), page="A. Ohm")
    assert not (tmp_path / "c").exists()
