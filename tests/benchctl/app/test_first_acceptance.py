"""The acceptance beside a recording, its limits and its values, whoever wrote it."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from benchctl.app.rerun import acceptance_beside
from benchctl.metrology.limit_file import limits_of_text
from benchctl.metrology.result import Judged, Limit, Measured, Uncertainty, message
from benchctl_instruments.errors import UsageError

TEXT = '[limits.bias]\nlow = -1.0\nhigh = 1.0\nunit = "deg/h"\n'
SHA256 = limits_of_text(TEXT, Path("limits.toml")).sha256
BIAS = {"name": "bias", "value": 0.5, "unit": "deg/h", "verdict": "PASS"}


def _write(folder: Path, *, tests: Any = (BIAS,), limits: Any = None, **more: Any) -> Path:
    content = {
        "schema": "benchctl-acceptance/1",
        "recording_digest": "d1",
        "limits": limits or {"text": TEXT, "sha256": SHA256},
        "tests": tests,
        **more,
    }
    (folder / "acceptance.json").write_text(json.dumps(content))
    return folder / "recording.h5"


def _found(value: float | None = 0.5) -> Judged:
    agrees = message("gum_agrees", difference_percent=0.0)
    known = Uncertainty(standard=0.05, expanded=0.1, monte_carlo=0.1, contributors=(), says=agrees)
    measured = Measured(name="bias", unit="deg/h", value=value, uncertainty=None if value is None else known)
    return Judged(measured=measured, limit=Limit(low=-1.0, high=1.0, unit="deg/h"), verdict="PASS")


def _unlike(folder: Path, told: Mapping[str, Any], found: Judged) -> list[str]:
    stated = acceptance_beside(_write(folder, tests=[told]), "d1")
    assert stated is not None
    return list(stated.unlike([found]))


def test_where_nothing_lies_there_is_nothing(tmp_path: Path) -> None:
    assert acceptance_beside(tmp_path / "recording.h5", "d1") is None


def test_its_limits_are_those_of_the_file_then(tmp_path: Path) -> None:
    stated = acceptance_beside(_write(tmp_path), "d1")
    assert stated is not None
    assert stated.limits().text == TEXT
    assert stated.limits().limits["bias"].high == 1.0


def test_of_a_file_alone_it_lies_in_the_folder_of_its_results(tmp_path: Path) -> None:
    (tmp_path / "sweep.acceptance").mkdir()
    _write(tmp_path / "sweep.acceptance")
    assert acceptance_beside(tmp_path / "sweep.h5", "d1") is not None


def test_the_same_values_are_like_and_what_no_digit_shows_is_like(tmp_path: Path) -> None:
    assert _unlike(tmp_path, BIAS, _found()) == []
    assert _unlike(tmp_path, BIAS, _found(0.5009)) == []


def test_other_values_units_and_verdicts_are_told(tmp_path: Path) -> None:
    assert _unlike(tmp_path, BIAS, _found(0.6)) == ["bias was stated as 0.5 'deg/h', is found as 0.6 'deg/h' today"]
    assert "0.5 'deg/s'" in _unlike(tmp_path, {**BIAS, "unit": "deg/s"}, _found())[0]
    assert _unlike(tmp_path, {**BIAS, "verdict": "FAIL"}, _found()) == [
        "bias was stated as 'FAIL', is found 'PASS' today"
    ]
    assert len(_unlike(tmp_path, {**BIAS, "value": None}, _found())) == 1
    assert len(_unlike(tmp_path, {}, _found())) == 1


@pytest.mark.parametrize("value", [True, "0.5", [0.5], {"a": 1}, 1e400])
def test_a_value_that_is_no_number_is_told_as_another(tmp_path: Path, value: object) -> None:
    assert len(_unlike(tmp_path, {**BIAS, "value": value}, _found())) == 1


def test_the_acceptance_of_another_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="is the acceptance of another recording than"):
        acceptance_beside(_write(tmp_path), "d2")


@pytest.mark.parametrize("content", ["[]", "{}", '{"limits": {}, "tests": 3}', "{", '{"limits": {}, "tests": []}'])
def test_what_is_no_acceptance_is_refused_in_one_line(tmp_path: Path, content: str) -> None:
    (tmp_path / "acceptance.json").write_text(content)
    with pytest.raises(UsageError) as refused:
        acceptance_beside(tmp_path / "recording.h5", "d1")
    assert "\n" not in str(refused.value)


def test_changed_or_missing_limits_are_refused(tmp_path: Path) -> None:
    changed = acceptance_beside(_write(tmp_path, limits={"text": TEXT + "\n", "sha256": SHA256}), "d1")
    assert changed is not None
    with pytest.raises(UsageError, match="its limits were changed since it was written"):
        changed.limits()
    missing = acceptance_beside(_write(tmp_path, limits={"file": "limits.toml"}), "d1")
    assert missing is not None
    with pytest.raises(UsageError, match="keeps no text of its limits; name them with --limits"):
        missing.limits()
