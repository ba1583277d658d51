"""A step that homes the table: it asks first, is recorded, and is refused for a table without a home."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from benchctl.bench import Bench
from benchctl.campaign.check import problems
from benchctl.campaign.opened import open_bench
from benchctl.campaign.operator import HOME_QUESTION, AnswerFile, Answers, questions
from benchctl.campaign.runner import run_campaign
from benchctl.plan import Home
from benchctl.plan.written import plan_source
from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import verify
from benchctl_instruments.interfaces import TableLimits
from tests.benchctl.campaign.by_hand import BENCH, REST, SOAK, done, plan_of

PLAN = plan_of(SOAK, Home(), REST)


def with_table(model: str) -> Bench:
    return BENCH.model_copy(update={"rate_table": BENCH.rate_table.model_copy(update={"model": model})})


@pytest.mark.parametrize(
    ("model", "answer", "wires"),
    [
        ("newport_esp301", "done", True),
        ("aerotech_ensemble", "done", True),
        ("newport_esp301", "done", False),
        ("newport_esp301", "refuse", False),
    ],
)
def test_the_table_is_homed_once_the_operator_permits_it(model: str, answer: str, wires: bool, tmp_path: Path) -> None:
    with open_bench(with_table(model), wires=wires) as opened:
        table = opened.table
        table.set_limits(TableLimits(rate_dps=BENCH.limits.rate_dps, acceleration_dps2=BENCH.limits.acceleration_dps2))
        table.enable()
        table.go_to_rate(30.0)
        opened.clock.sleep(2.0)
        table.stop()
        opened.clock.sleep(1.0)
        file = Answers(path=Path("answers.toml"), by_question={HOME_QUESTION: answer})
        answered = replace(opened, operator=AnswerFile(file, "U", opened.operator))
        outcome = run_campaign(PLAN, answered, tmp_path / "c")
        angle_deg = table.read().angle_deg
    if answer == "refuse":
        assert (outcome.status, outcome.whole) == ("interrupted", 1)
        assert 20.0 < angle_deg < 90.0
        return
    assert (outcome.status, outcome.whole, verify(outcome.recording)) == ("complete", 3, [])
    assert (angle_deg + 180.0) % 360.0 == pytest.approx(180.0, abs=0.1)
    assert done(outcome.campaign) == [HOME_QUESTION]
    with open_recording(outcome.recording) as recording:
        homed = recording.step(2).info
        assert (homed.kind, homed.role, homed.samples, homed.whole) == ("home", "none", 0, True)


def test_the_question_is_known_beforehand_and_the_plan_is_written_as_it_is() -> None:
    assert [(one.step, one.text) for one in questions(enumerate(PLAN.steps, 1), "U")] == [(2, HOME_QUESTION)]
    assert "    yield Home()" in plan_source(PLAN, "again")


@pytest.mark.parametrize("model", ["acutrol3000", "manual"])
def test_a_table_without_a_home_is_refused_before_anything_moves(model: str) -> None:
    assert problems(PLAN, with_table("newport_esp301")) == []
    found = problems(PLAN, with_table(model))
    assert f"homes the table, and the bench's table, {model}, has no home; leave the step out" in found[0].message
    assert found[0].step == 2
