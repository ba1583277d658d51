"""`benchctl apply`: a recording with its compensated rate, or one line that says why not."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchctl.calibration.coefficients import coefficients, write_coefficients
from benchctl.cli.app import run_verb
from benchctl.recordings.model import Step
from benchctl.recordings.reader import open_recording
from benchctl.recordings.writer import write_recording
from tests.benchctl.calibration.campaigns import TRUTH, calibrated, recorded
from tests.benchctl.calibration.made_coefficients import written
from tests.benchctl.calibration.synthetic import meta_of
from tests.benchctl.recordings import made

Verb = Callable[..., tuple[int, str, str]]


@pytest.fixture
def verb(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Verb:
    """Run a verb in an empty folder; returns its status, what it says, and its complaints."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str | Path) -> tuple[int, str, str]:
        status = run_verb([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Three steps at 50 °/s and more, of the unit that the hand-made coefficients are of."""
    return made.recording(tmp_path)


def test_what_was_fitted_is_applied_verified_and_true(verb: Verb, tmp_path: Path) -> None:
    write_recording(tmp_path / "a.h5", meta_of(TRUTH), recorded())
    write_coefficients(tmp_path / "coefficients.json", coefficients(calibrated(), [("a.h5", "ab" * 32)]))
    status, out, _ = verb("apply", "a.h5", "--coefficients", "coefficients.json", "--json", "out.json")
    assert status == 0
    assert "a_compensated.h5: " in out
    assert verb("verify", "a_compensated.h5")[0] == 0
    told: dict[str, Any] = json.loads((tmp_path / "out.json").read_text())
    assert (told["schema"], told["ok"], told["law"]) == ("benchctl-apply/1", True, "joint")
    assert (told["recording"], told["coefficients"]) == ("a_compensated.h5", "coefficients.json")
    with open_recording(tmp_path / "a_compensated.h5") as new:
        steps = list(new.steps(kinds=["constant_rate"]))
        assert told["samples"] == sum(info.samples for info in new.infos)
    true = np.array([step.info.rate_dps for step in steps], dtype=float) + TRUTH.earth
    found = np.array([step["compensated_dps"].mean() for step in steps])
    by_line = np.array([(step["gyro_v"].mean() - TRUTH.U0) / TRUTH.K0 for step in steps])
    assert np.abs(by_line - true).max() > 5.0
    assert np.abs(found - true).max() < 0.02


def test_the_samples_outside_are_counted_and_said(verb: Verb, recording: Path, tmp_path: Path) -> None:
    valid = {"rate_dps": [-10.0, 10.0], "temperature_c": [-40.0, 60.0]}
    written(tmp_path, valid=valid)
    status, out, _ = verb("apply", recording, "--coefficients", "coefficients.json", "-o", "c.h5", "--json", "o.json")
    told = json.loads((tmp_path / "o.json").read_text())
    assert status == 0
    assert 0 < told["outside"] <= told["samples"] == 600
    assert f"note: {told['outside']:,} samples lie where the coefficients were not measured" in out
    assert told["outside_most"]["rate_dps"] > 1.0


def test_the_law_is_chosen(verb: Verb, recording: Path, tmp_path: Path) -> None:
    written(tmp_path)
    for law in ("joint", "stages"):
        assert verb("apply", recording, "--coefficients", "coefficients.json", "--law", law, "-o", f"{law}.h5")[0] == 0
    with open_recording(tmp_path / "joint.h5") as joint, open_recording(tmp_path / "stages.h5") as stages:
        assert not np.array_equal(joint.step(1)["compensated_dps"], stages.step(1)["compensated_dps"])


def test_steps_without_thermistor_are_named(verb: Verb, tmp_path: Path) -> None:
    whole = made.step(1)
    bare = Step(made.info(2), {name: values for name, values in whole.channels.items() if name != "gyro_temp_c"})
    write_recording(tmp_path / "a.h5", made.meta(), [whole, bare])
    written(tmp_path)
    status, out, _ = verb("apply", "a.h5", "--coefficients", "coefficients.json")
    assert status == 0
    assert "note: 1 steps have no gyro_temp_c and got no rate: 2" in out


def _refused(verb: Verb, *arguments: str | Path) -> str:
    status, out, err = verb("apply", *arguments)
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    return err


def test_what_is_there_already_is_left(verb: Verb, recording: Path, tmp_path: Path) -> None:
    written(tmp_path)
    (tmp_path / "made_compensated.h5").write_text("mine")
    assert "is there already" in _refused(verb, recording, "--coefficients", "coefficients.json")
    assert "is there already" in _refused(verb, recording, "--coefficients", "coefficients.json", "-o", recording)
    assert (tmp_path / "made_compensated.h5").read_text() == "mine"
    assert "is a folder" in _refused(verb, recording, "--coefficients", "coefficients.json", "-o", ".")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{", "not JSON"),
        ("[]", "expected schema 'benchctl-coefficients/1', found 'list'"),
        ('{"schema": "benchctl-coefficients/2"}', "found 'benchctl-coefficients/2'"),
    ],
)
def test_coefficients_that_are_none_are_refused(
    verb: Verb, recording: Path, tmp_path: Path, text: str, says: str
) -> None:
    (tmp_path / "coefficients.json").write_text(text)
    assert says in _refused(verb, recording, "--coefficients", "coefficients.json")
    assert "none.json" in _refused(verb, recording, "--coefficients", "none.json")
    assert not (tmp_path / "made_compensated.h5").exists()


def test_what_does_not_fit_together_is_refused(verb: Verb, recording: Path, tmp_path: Path) -> None:
    written(tmp_path, unit="VG-8")
    assert "of unit VG-7, the coefficients are of unit VG-8" in _refused(
        verb, recording, "--coefficients", "coefficients.json"
    )
    written(tmp_path, joint=None)
    assert "no joint fit" in _refused(verb, recording, "--coefficients", "coefficients.json", "--law", "joint")
    points = made.polled(0.0)
    write_recording(tmp_path / "points.h5", made.meta(), [Step(made.info(1, kind="static_points"), points)])
    assert "nothing to compensate" in _refused(verb, "points.h5", "--coefficients", "coefficients.json")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["coefficients.json", "made.h5", "points.h5"]


def test_a_recording_that_changed_is_refused(verb: Verb, recording: Path, tmp_path: Path) -> None:
    written(tmp_path)
    recording.write_bytes(recording.read_bytes().replace(b"VG910Q", b"VG910X"))
    line = _refused(verb, recording, "--coefficients", "coefficients.json", "--json", "out.json")
    assert "changed since it was written, and so not compensated" in line
    assert json.loads((tmp_path / "out.json").read_text())["ok"] is False
