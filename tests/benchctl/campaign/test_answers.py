"""Answers given beforehand, in the place of an operator's: read, held against the plan's questions, and acted upon."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from benchctl.campaign.operator import AnswerFile, Answers, Question, answer_line, questions, read_answers
from benchctl.campaign.stop import StoppedError
from benchctl.plan import Ask, Mount, PowerCycle, Static
from benchctl_instruments.errors import UsageError

DOOR, OFF, ON = "close the chamber's door", "switch the supply of unit U off", "switch the supply of unit U on"
ACROSS = "mount unit U with its input axis across the table's axis, then stand clear of the table"
STEPS = (Ask(says=DOOR), PowerCycle(), Static(duration_s=1.0), Mount(position="across"), Ask(says=DOOR))


def asked() -> list[Question]:
    return list(questions(enumerate(STEPS, 1), "U"))


def answers(**by_question: str) -> Answers:
    return Answers(path=Path("answers.toml"), by_question=by_question)


def test_all_that_a_plan_asks_is_known_beforehand_in_its_order() -> None:
    assert [(one.step, one.text) for one in asked()] == [(1, DOOR), (2, OFF), (2, ON), (4, ACROSS), (5, DOOR)]
    broken_off = list(questions([(2, STEPS[1])], "U", may_be_off=True))
    assert [one.text for one in broken_off] == [ON, OFF, ON]
    assert list(questions([(3, STEPS[2])], "U")) == []


def test_a_file_is_read_by_question(tmp_path: Path) -> None:
    path = tmp_path / "answers.toml"
    path.write_text(f'"{DOOR}" = "done"\n"{OFF}" = "refuse"\n', encoding="utf-8")
    assert read_answers(path).by_question == {DOOR: "done", OFF: "refuse"}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('"x" = "yes"', 'x: expected "done" or "refuse", got \'yes\''),
        ('"x" = 1', 'x: expected "done" or "refuse", got 1'),
        ('[x]\ny = "done"', 'x: expected "done" or "refuse", got {'),
        ('"x" "done"', "not TOML"),
        ('"x" = "done"\n"x" = "done"', "not TOML"),
    ],
)
def test_a_file_that_answers_nothing_is_one_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "answers.toml"
    path.write_text(text)
    with pytest.raises(UsageError) as caught:
        read_answers(path)
    assert str(caught.value).startswith(f"answers {path}: ")
    assert says in str(caught.value)


def test_questions_without_an_answer_are_named_in_full_as_the_file_would_have_them() -> None:
    given = answers(**{DOOR: "done", OFF: "done"})
    with pytest.raises(UsageError) as caught:
        given.refuse_unanswered(asked())
    said = str(caught.value)
    assert said.startswith("answers answers.toml: 2 of the plan's questions have no answer")
    lines = [answer_line(ON), answer_line(ACROSS)]
    assert ", ".join(lines) in said
    assert tomllib.loads("\n".join(lines)) == {ON: "done", ACROSS: "done"}
    assert "(for the first there is only " in said  # off, in the place of on
    everything = {one.text: "done" for one in asked()}
    answers(**everything, **{"what nobody asks": "refuse"}).refuse_unanswered(asked())


def test_a_question_in_any_letters_is_one_key() -> None:
    says = 'öffne die Tür: "A\\B" °'
    assert tomllib.loads(answer_line(says)) == {says: "done"}


class Doing:
    who = "somebody"

    def __init__(self) -> None:
        self.did: list[object] = []

    def power(self, on: bool, meanwhile: object) -> None:
        self.did.append(on)

    def mount(self, position: str, meanwhile: object) -> None:
        self.did.append(position)

    def ask(self, says: str, meanwhile: object) -> None:
        self.did.append(says)


def test_what_is_answered_done_is_done_by_the_simulated_bench_and_a_refusal_ends_the_run() -> None:
    doing = Doing()
    operator = AnswerFile(answers(**{DOOR: "done", OFF: "done", ON: "refuse", ACROSS: "done"}), "U", doing)
    operator.ask(DOOR, lambda: None)
    operator.power(False, lambda: None)
    operator.mount("across", lambda: None)
    assert doing.did == [DOOR, False, "across"]
    with pytest.raises(StoppedError, match=f"stopped by the answers of answers.toml: refused to {ON}"):
        operator.power(True, lambda: None)
    assert doing.did == [DOOR, False, "across"]
    assert operator.who == "the answers of answers.toml"


def test_at_addresses_nobody_else_has_a_hand_in_it() -> None:
    operator = AnswerFile(answers(**{DOOR: "done"}), "U", None)
    operator.ask(DOOR, lambda: None)
    with pytest.raises(StoppedError):
        operator.mount("across", lambda: None)
