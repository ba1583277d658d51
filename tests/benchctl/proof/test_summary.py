"""A proof in numbers."""

import json
from pathlib import Path

import pytest

from benchctl.proof.confusion import ADDED, NOTHING, UNKNOWN, WITHHELD
from benchctl.proof.summary import Summary, summarize
from benchctl.proof.trial import Answer, Trial, read_trial, write_trial
from benchctl_instruments.errors import UsageError
from tests.benchctl.proof.made import finding, said, trial, truth

LAG = {"thermal_lag": {"tau_s": 300.0}}
PAIR = {**LAG, "warm_up": {"amplitude_v": 1e-3, "tau_s": 100.0}}
OUTSIDER = truth("outsider", LAG, withheld=("thermal_lag",), lives_in=("gyro_temp_rate",))

TRIALS = [
    trial(0, truth("nothing"), said(verdict="consistent"), ()),
    trial(1, truth("nothing"), said(finding("warm_up")), ("warm_up", "bias_drift")),
    trial(2, truth("single", LAG), said(finding("thermal_lag", tau_s=(310.0, 305.0, 315.0))), ("thermal_lag",)),
    trial(3, truth("single", LAG), said(finding("thermal_hysteresis")), ()),
    trial(4, truth("pair", PAIR), said(finding("thermal_lag", tau_s=(450.0, 250.0, 600.0))), ("bias_drift",)),
    trial(5, OUTSIDER, said(verdict="unknown-structure", where=("gyro_temp_rate",)), ("warm_up",)),
    trial(6, truth("single", LAG), said(finding("thermal_lag"), finding("bias_drift")), ("thermal_lag",)),
]


@pytest.fixture
def summary() -> Summary:
    return summarize(3, TRIALS[::-1])


def test_classes_count_what_was_right_and_what_was_not(summary: Summary) -> None:
    rows = {row.kind: row for row in summary.classes}
    assert list(rows) == ["nothing", "single", "pair", "outsider"]
    assert str(rows["nothing"].right) == "1 of 2"
    assert str(rows["single"].right) == "1 of 3"
    assert (rows["single"].missed, rows["single"].made_up) == (1, 2)
    assert str(rows["outsider"].right) == "1 of 1"
    assert str(rows["outsider"].generic) == "0 of 1"


def test_both_arms_are_counted_over_all_trials(summary: Summary) -> None:
    physics, generic = summary.physics, summary.generic
    assert generic is not None
    assert str(physics.named) == "3 of 5"
    assert str(generic.named) == "2 of 5"
    assert str(physics.false_alarms) == "1 of 2"
    assert (physics.made_up, generic.made_up) == (3, 4)
    assert str(physics.near) == "1 of 2"
    assert str(physics.inside_ci95) == "1 of 2"
    assert physics.held_out == pytest.approx(1.01)
    assert (physics.seconds, physics.peak_bytes) == (12.0, 2**29)


def test_the_matrix_says_what_was_taken_for_what(summary: Summary) -> None:
    matrix = summary.confusion
    count = {
        (row, column): int(matrix.counts[i, j])
        for i, row in enumerate(matrix.rows)
        for j, column in enumerate(matrix.columns)
        if matrix.counts[i, j]
    }
    assert count == {
        (NOTHING, NOTHING): 1,
        (NOTHING, "warm_up"): 1,
        ("thermal_lag", "thermal_lag"): 3,
        ("thermal_lag", "thermal_hysteresis"): 1,
        ("warm_up", NOTHING): 1,
        (WITHHELD, UNKNOWN): 1,
        (ADDED, "bias_drift"): 1,
    }
    right = {(matrix.rows[i], matrix.columns[j]) for i in range(len(matrix.rows)) for j in range(len(matrix.columns))
             if matrix.is_right(i, j)}  # fmt: skip
    assert (WITHHELD, UNKNOWN) in right
    assert (NOTHING, NOTHING) in right
    assert ("warm_up", NOTHING) not in right


def test_programs_get_the_keys_that_they_rely_on(summary: Summary) -> None:
    told = json.loads(json.dumps(summary.as_json(), allow_nan=False))
    assert told["trials"] == 7
    assert told["named"] == pytest.approx(0.6)
    assert told["false_alarms"] == pytest.approx(0.5)
    assert told["held_out"] == pytest.approx(1.01)
    assert {"trials", "named", "false_alarms", "held_out"} <= told["generic"].keys()
    assert [row["class"] for row in told["classes"]] == ["nothing", "single", "pair", "outsider"]
    assert len(told["digests"]) == 7


def test_a_trial_without_an_answer_is_not_right_and_one_arm_may_be_missing() -> None:
    silent = Trial(
        index=0, kind="single", digest="d", truth=truth("single", LAG).as_json(), rows=1, recorded_s=1.0,
        physics=Answer(score=None, error="it failed"), generic=None,
    )  # fmt: skip
    summary = summarize(1, [silent])
    assert str(summary.classes[0].right) == "0 of 1"
    assert summary.physics.silent == 1
    assert summary.physics.held_out is None
    assert summary.generic is None
    assert summary.confusion.rows == ()
    assert summary.as_json()["generic"] is None


@pytest.mark.parametrize("kept", TRIALS, ids=lambda one: str(one.index))
def test_a_trial_comes_back_from_its_file_as_it_was(kept: Trial, tmp_path: Path) -> None:
    path = tmp_path / "0.json"
    write_trial(path, kept)
    back = read_trial(path)
    assert back.as_json() == kept.as_json()
    assert summarize(1, [back]).as_json() == summarize(1, [kept]).as_json()


@pytest.mark.parametrize("text", ['{"index": 1}', "[]", "[" * 100_000, "\0"])
def test_a_file_that_is_no_trial_is_named(text: str, tmp_path: Path) -> None:
    path = tmp_path / "0.json"
    path.write_text(text)
    with pytest.raises(UsageError, match=r"0.json: is no trial of this program's; remove it"):
        read_trial(path)
