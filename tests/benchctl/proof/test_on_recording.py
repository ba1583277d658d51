"""Sealed trials on a recording that is there: an effect is added to it, and is to be named beside what it shows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchctl.cli.app import run_verb
from benchctl.diagnosis import diagnose
from benchctl.proof import inject
from benchctl.proof.injection import FAIR, Injection, Untouched
from benchctl.proof.on_recording import _scored
from benchctl.recordings.reader import open_recording
from benchctl_instruments.arrays import FloatArray
from tests.benchctl.cli.processes import benchctl
from tests.benchctl.diagnosis.gyro.test_response import stepped_recording
from tests.benchctl.diagnosis.moving import KINDS, NOISE_V, write_moving

SQUARED = Injection(index=0, effect="rate_squared", parameters={"v_per_dps2": 2e-6}, share=1.0, nonce="")


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_moving(tmp_path_factory.mktemp("plain") / "plain.h5", kinds=KINDS * 2)


@pytest.fixture(scope="module")
def said(plain: Path) -> dict[str, object]:
    with open_recording(plain) as recording:
        return diagnose(recording).as_json()


def test_only_the_output_is_changed_and_by_what_the_effect_does(plain: Path, said: dict[str, object]) -> None:
    with open_recording(plain) as recording:
        steps = list(recording.steps())
        changed = list(Untouched(recording, said).with_it(SQUARED))
    for step, other in zip(steps, changed, strict=True):
        assert other.info == step.info
        for name in set(step.channels) - {"gyro_v"}:
            np.testing.assert_array_equal(other[name], step[name])
    turning = next(step for step in range(len(steps)) if steps[step].info.kind == "constant_rate")
    added = changed[turning]["gyro_v"] - steps[turning]["gyro_v"]
    assert added[100:-100] == pytest.approx(2e-6 * 40.0**2, rel=0.01)


def test_an_effect_is_added_to_the_model_with_what_was_found_without_a_name(
    plain: Path, said: dict[str, object]
) -> None:
    values = {"change": {"value": 1.0}, "at": {"value": -1e3}, "width": {"value": 1.0}}  # doubles the scale factor
    doubled = {**said, "unexplained": {"model": {"name": "step_of_scale_over_time", "parameters": values}}}
    one = Injection(index=0, effect="scale_asymmetry", parameters={"fraction": 0.01}, share=1.0, nonce="")

    def added(answer: dict[str, object]) -> FloatArray:
        steps = zip(recording.steps(), Untouched(recording, answer).with_it(one), strict=True)
        return np.concatenate([other["gyro_v"] - step["gyro_v"] for step, other in steps])

    with open_recording(plain) as recording:
        assert added(doubled) == pytest.approx(2.0 * added(said), rel=0.01, abs=1e-6)


def test_a_limit_cuts_the_samples_themselves(plain: Path, said: dict[str, object]) -> None:
    limit = Injection(index=0, effect="saturation", parameters={"limit_v": 0.6}, share=1.0, nonce="")
    with open_recording(plain) as recording:
        changed = np.concatenate([step["gyro_v"] for step in Untouched(recording, said).with_it(limit)])
    assert changed.max() == pytest.approx(0.6, abs=1e-12)
    assert np.count_nonzero(changed > 0.6 - 1e-9) > 100


@pytest.mark.slow
def test_a_limit_is_drawn_for_a_motion_beyond_the_band_too(said: dict[str, object]) -> None:
    recording = stepped_recording(0.012, 0.0, 0.0, 0.0, np.inf, 46.0)
    baseline = {"K0_v_per_dps": {"value": 1.0}, "U0_v": {"value": 0.0}}
    told = {**said, "findings": [], "baseline": {"parameters": baseline}, "fit": {"after": 0.3}}
    untouched = Untouched(recording, told)
    assert any(untouched.drawn(1, index).effect in {"saturation", "two_rails"} for index in range(24))


@pytest.mark.parametrize(("probability", "named", "made_up"), [(0.4, True, []), (0.01, False, ["scale_asymmetry"])])
def test_an_effect_counts_as_named_where_it_is_stated_as_the_alternative(
    probability: float, named: bool, made_up: list[str]
) -> None:
    rival = {"effect": "rate_squared", "probability": probability}
    findings = [
        {"effect": "scale_asymmetry", "parameters": {}, "alternatives": [rival]},
        {"effect": "timing_offset", "parameters": {}, "alternatives": []},
    ]
    found = {"said": {"findings": findings}, "seconds": 1.0}
    trial = _scored(SQUARED, "", (frozenset({"timing_offset"}),), found)
    assert (trial.named, trial.made_up, trial.lost) == (named, made_up, [])
    assert trial.instead == ("scale_asymmetry" if named else "")


@pytest.mark.parametrize(("stated", "lost"), [("low_pass", []), ("scale_asymmetry", ["low_pass or timing_offset"])])
def test_what_was_there_is_lost_where_neither_it_nor_its_alternative_is_stated(stated: str, lost: list[str]) -> None:
    found = {"said": {"findings": [{"effect": stated, "parameters": {}, "alternatives": []}]}, "seconds": 1.0}
    assert _scored(SQUARED, "", (frozenset({"timing_offset", "low_pass"}),), found).lost == lost


def test_what_is_drawn_is_the_same_for_a_seed_shows_as_it_says_and_is_nothing_that_was_there(
    plain: Path, said: dict[str, object]
) -> None:
    with open_recording(plain) as recording:
        untouched = Untouched(recording, said)
        drawn = [untouched.drawn(3, index) for index in range(8)]
        assert Untouched(recording, said).drawn(3, 5) == drawn[5]
        assert len({one.digest() for one in drawn}) == 8
        assert len({one.effect for one in drawn}) > 3
        for one in drawn:
            assert FAIR[0] <= one.share <= FAIR[1]
            added = [
                other["gyro_v"] - step["gyro_v"]
                for step, other in zip(recording.steps(), untouched.with_it(one), strict=True)
            ]
            # the baseline takes a part of it up, so that more is added than shows
            assert np.sqrt(np.mean(np.concatenate(added) ** 2)) > 0.9 * one.share * NOISE_V
        own = {"effect": "rate_squared", "parameters": {"v_per_dps2": {"value": 1e-6}}, "alternatives": []}
        found = {**said, "findings": [own]}
        again = Untouched(recording, found)
        assert "rate_squared" not in {again.drawn(3, index).effect for index in range(8)}


def test_the_digest_is_told_and_the_recording_says_nothing_of_it(
    plain: Path, said: dict[str, object], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "said.json").write_text(json.dumps({"said": said}), encoding="utf-8")
    asked = ["--said", tmp_path / "said.json", "--seed", 3, "--index", 2, "--out", tmp_path / "r.h5"]
    assert inject.main([str(plain), *map(str, asked)]) == 0
    with open_recording(plain) as recording, open_recording(tmp_path / "r.h5") as injected:
        drawn = Untouched(recording, said).drawn(3, 2)
        assert injected.meta == recording.meta
    assert json.loads(capsys.readouterr().out) == {"digest": drawn.digest()}
    assert drawn.effect.encode() not in (tmp_path / "r.h5").read_bytes()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--part", "table"), "--part table: is no part of a bench; there are gyro, drive, chamber"),
        (("--class", "single"), "--on: goes with --part, --trials, --seed, --jobs and --out; leave the others out"),
    ],
)
def test_what_does_not_go_with_a_recording_is_refused(
    words: tuple[str, ...], told: str, plain: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_verb(["prove", "--on", str(plain), *words, "--out", str(tmp_path / "p")]) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "p").exists()


@pytest.mark.slow
def test_a_recording_whose_diagnosis_leaves_too_much_for_any_effect_is_refused_in_one_line(
    plain: Path, said: dict[str, object], tmp_path: Path
) -> None:
    proof = tmp_path / "p"
    proof.mkdir()
    (proof / "untouched.json").write_text(json.dumps({"said": {**said, "fit": {"after": 1e6}}}))
    ran = benchctl("prove", "--on", plain, "--trials", "1", "--seed", "3", "--out", proof, timeout_s=120.0)
    assert ran.returncode == 2
    assert ran.stderr.count("\n") == 1
    assert "trial 0: " in ran.stderr
    assert "take one with more motion" in ran.stderr


@pytest.mark.long
@pytest.mark.timeout(600)
def test_most_added_effects_are_named_beside_what_is_there(plain: Path, tmp_path: Path) -> None:
    asked = ("--on", plain, "--trials", "4", "--seed", "3", "--out", tmp_path / "proof", "--json", tmp_path / "p.json")
    ran = benchctl("prove", *asked, timeout_s=550.0)
    assert ran.returncode == 0, ran.stderr
    found = json.loads((tmp_path / "p.json").read_text())
    assert (found["trials"], found["lost"]) == (4, 0)
    assert found["right"] >= 3  # a rail that the output reaches on one side only looks like a symmetric limit
    assert sum(row["trials"] for row in found["effects"]) == 4
    for digest in found["digests"]:
        assert f"sealed, sha256 {digest}" in ran.stdout
    assert not list((tmp_path / "proof").glob("**/*.h5"))
    assert benchctl("prove", *asked, timeout_s=60.0).returncode == 0  # nothing is left to run
