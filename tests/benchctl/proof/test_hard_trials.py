"""Sealed trials that a diagnosis once got wrong."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import pytest

from benchctl.campaign.stop import StopRequest
from benchctl.diagnosis import diagnose
from benchctl.diagnosis.result import Finding
from benchctl.proof.draw import draw
from benchctl.proof.processes import run_module
from benchctl.recordings.reader import open_recording

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


def found_in_trial(folder: Path, seed: int, index: int, kind: str) -> Mapping[str, Finding]:
    words = ("--seed", str(seed), "--index", str(index), "--class", kind, "--out", str(folder / "campaign"))
    told = run_module("benchctl.proof.seal", *words, stop=StopRequest(), longest_s=300.0)
    recording = next(one["recording"] for one in map(json.loads, told.splitlines()) if "recording" in one)
    with open_recording(Path(recording)) as opened:
        return {one.effect: one for one in diagnose(opened).findings}


def test_a_fold_beside_a_hysteresis_is_found_though_the_law_bends_far_off_without_it(tmp_path: Path) -> None:
    found = found_in_trial(tmp_path, 6, 4, "pair")
    truth = draw(6, 4, "pair")
    assert found.keys() == truth.effects.keys() == {"thermal_hysteresis", "fringe_ambiguity"}
    fold_dps = truth.effects["fringe_ambiguity"]["fold_dps"]
    assert found["fringe_ambiguity"].parameters["fold_dps"].value == pytest.approx(fold_dps, abs=0.01)


def test_a_flicker_that_few_pieces_follow_better_over_temperature_than_over_time_is_no_structure(
    tmp_path: Path,
) -> None:
    found = found_in_trial(tmp_path, 7, 11, "wandering")
    assert found.keys() == draw(7, 11, "wandering").effects.keys() == {"flicker_noise"}
