"""Sealed trials of drives and chambers: what they draw, and what their recordings hold."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchctl.campaign.stop import StopRequest
from benchctl.diagnosis.diagnose import diagnose
from benchctl.proof import seal
from benchctl.proof.classes import ClassName
from benchctl.proof.part_trials import PartTruth, drawn
from benchctl.proof.running import ProofSettings, run_proof
from benchctl.proof.score import score_diagnosis
from benchctl.recordings.reader import open_recording
from benchctl_instruments.physics.structures import structure_named

PARTS: tuple[ClassName, ...] = ("drive", "chamber")


@pytest.mark.parametrize("part", PARTS)
def test_a_trial_of_a_part_is_drawn_again_with_the_same_digest_and_conceals_no_two_that_look_alike(
    part: ClassName,
) -> None:
    seen: set[str] = set()
    for index in range(60):
        truth = drawn(5, index, part)
        assert truth.digest() == drawn(5, index, part).digest() != drawn(6, index, part).digest()
        assert 1 <= len(truth.effects) <= 2 if index % 4 < 3 else not truth.effects
        assert truth.verdict == ("missing-physics" if truth.effects else "consistent")
        for name in truth.effects:
            assert not set(truth.kind_of(name).look_alikes) & set(truth.effects)
        seen |= set(truth.effects)
    assert len(seen) == (5 if part == "drive" else 6)


@pytest.mark.parametrize(
    ("kind", "stage", "over"),
    [
        ("drive-structure", "torque", {"angle", "time", "rate"}),
        ("chamber-structure", "heat", {"time", "chamber_temp", "heater"}),
    ],
)
def test_what_has_no_name_is_drawn_alone_or_beside_one_effect_and_withheld(
    kind: ClassName, stage: str, over: set[str]
) -> None:
    beside: set[int] = set()
    where: set[str] = set()
    for index in range(60):
        truth = drawn(5, index, kind)
        (structure,) = truth.withheld
        found = structure_named(structure)
        assert found is not None
        assert (found.acts_on, truth.lives_in) == (stage, (found.over,))
        assert truth.kind_of(structure) is found
        assert truth.verdict == ("missing-physics" if truth.nameable else "unknown-structure")
        beside.add(len(truth.nameable))
        where.add(found.over)
    assert (beside, where) == ({0, 1}, over)


@pytest.mark.parametrize("part", PARTS)
def test_the_recording_of_a_part_says_nothing_of_what_its_trial_conceals(
    part: ClassName, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["--seed", "5", "--index", "0", "--class", part, "--out", str(tmp_path / "run")]
    assert seal.main(asked) == 0
    first, last = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    truth = drawn(5, 0, part)
    assert isinstance(truth, PartTruth)
    assert first == {"digest": truth.digest()}
    with open_recording(Path(last["recording"])) as recording:
        assert sum(info.samples for info in recording.infos) == last["rows"] > 1000
        told = json.dumps([dict(recording.meta.provenance), recording.meta.simulation, recording.meta.extra])
    for secret in (*truth.effects, *truth.baseline, str(truth.seed), truth.nonce):
        assert secret not in told


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("index", [3, 7])
def test_of_a_part_that_hides_nothing_nothing_is_stated(part: ClassName, index: int, tmp_path: Path) -> None:
    truth = drawn(83, index, part)
    path, _ = truth.record(tmp_path / "run")
    with open_recording(path) as recording:
        said = diagnose(recording, part="drive" if part == "drive" else "chamber")
    assert said.verdict == "consistent"
    assert not said.findings


@pytest.mark.slow
@pytest.mark.parametrize(
    ("index", "what"),
    [(6, "a rough place beside friction at low rates"), (10, "what harmonics stand for"), (18, "two bumps in time")],
)
def test_a_torque_without_a_name_is_found_over_its_coordinate_beside_the_right_name(
    index: int, what: str, tmp_path: Path
) -> None:
    truth = drawn(90, index, "drive-structure")
    path, _ = truth.record(tmp_path / "run")
    with open_recording(path) as recording:
        said = diagnose(recording, part="drive").as_json()
    score = score_diagnosis(truth, said)
    assert score.right, (what, said["says"])
    assert score.removed is not None
    assert score.removed > 0.99


@pytest.mark.slow
def test_a_drive_is_diagnosed_blind_and_scored_against_what_was_sealed(tmp_path: Path) -> None:
    settings = ProofSettings(seed=5, trials=1, only=("drive",), jobs=1)
    (trial,) = run_proof(settings, tmp_path, on_status=lambda _index, _what: None, stop=StopRequest())
    assert trial.generic is None
    assert trial.physics.right
    score = trial.physics.score
    assert score is not None
    assert {one.name for one in score.parameters} >= {"cogging_torque.amplitude_nm", "cogging_torque.order"}
    assert all(one.within(0.1) for one in score.parameters)
