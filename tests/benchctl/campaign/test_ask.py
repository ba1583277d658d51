"""A step that asks the operator for something: played, recorded, resumed, priced, and seen by no fit."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchctl.campaign.opened import open_bench
from benchctl.campaign.resume import steps_to_play
from benchctl.campaign.runner import Outcome, run_campaign
from benchctl.campaign.timing import OPERATOR_S, timeline
from benchctl.diagnosis.gyro.frame import frame_of
from benchctl.plan import Ask, ConstantRate
from benchctl.plan.steps import ByHand, Polled, faults
from benchctl.plan.written import plan_source
from benchctl.recordings.model import StepInfo
from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import verify
from benchctl.signals.reduce import reduce_steps
from tests.benchctl.campaign.by_hand import BENCH, REST, SOAK, events, plan_of

DOOR = Ask(says="close the chamber's door")
PLAN = plan_of(SOAK, DOOR, REST, ConstantRate(rate_dps=90.0, duration_s=4.0), DOOR, REST)


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    with open_bench(BENCH, wires=False) as opened:
        return run_campaign(PLAN, opened, tmp_path_factory.mktemp("asked") / "c")


def test_it_says_of_itself_what_is_to_be_done() -> None:
    assert (DOOR.kind, DOOR.label) == ("ask", "ask: close the chamber's door")
    assert isinstance(DOOR, ByHand)
    assert isinstance(DOOR, Polled)
    assert (DOOR.streamed_s, DOOR.peak_rate_dps) == (0.0, 0.0)
    assert list(faults(DOOR)) == []


@pytest.mark.parametrize(
    ("says", "error"),
    [("", ValueError), ("  ", ValueError), ("two\nlines", ValueError), ("x" * 161, ValueError), (5, TypeError)],
)
def test_a_question_that_is_no_line_of_text_is_refused(says: object, error: type[Exception]) -> None:
    with pytest.raises(error, match="Ask: says is"):
        Ask(says=says)  # type: ignore[arg-type]


def test_it_is_recorded_and_the_journal_says_who_did_what(played: Outcome) -> None:
    assert (played.status, played.whole) == ("complete", 6)
    assert verify(played.recording) == []
    with open_recording(played.recording) as recording:
        asked = recording.step(2)
        assert (asked.info.name, asked.info.kind, asked.info.role) == ("ask: close the chamber's door", "ask", "none")
        assert (asked.info.samples, asked.info.whole, asked.info.mounting) == (0, True, "")
        assert asked["poll_time_s"].size >= 1
    told = [(event["says"], event["by"]) for event in events(played.campaign, "operator")]
    assert told == [("close the chamber's door", "the simulated bench")] * 2


def test_neither_a_fit_nor_a_diagnosis_sees_it(played: Outcome) -> None:
    with open_recording(played.recording) as recording:
        assert {step.info.index for step in reduce_steps(recording.steps(), recording.meta)} == {3, 4, 6}
        assert [info.index for info in frame_of(recording).infos] == [3, 4, 6]


def test_it_takes_the_time_that_an_operator_is_taken_to_need() -> None:
    times = list(timeline(PLAN, BENCH.limits, 23.0))
    assert times[1][1] - times[1][0] == OPERATOR_S


def test_what_was_done_is_not_asked_again_and_what_was_not_is() -> None:
    def whole(*numbers: int) -> list[StepInfo]:
        return [StepInfo(index=n, name="", kind="", t_start=0.0, t_end=1.0, chamber_setpoint_c=23.0) for n in numbers]

    def left(*numbers: int) -> list[str]:
        return [step.label for _, _, step in steps_to_play(PLAN, whole(*numbers), 23.0)]

    assert left(1, 2)[:2] == ["soak at +23 again, before step 3", "static"]
    assert left(1, 2).count(DOOR.label) == 1
    assert left(1)[:2] == ["soak at +23 again, before step 2", DOOR.label]


def test_it_is_written_down_as_it_was(tmp_path: Path) -> None:
    text = plan_source(plan_of(DOOR), "again")
    assert '    yield Ask(says="close the chamber\'s door")' in text
    assert "from benchctl.plan import Ask, procedure" in text
