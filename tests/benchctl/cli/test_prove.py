"""`benchctl prove` as its users run it."""

import json
from pathlib import Path

import pytest

from benchctl.cli.app import run_verb
from benchctl.proof.generic.arm import available
from tests.benchctl.cli.processes import benchctl


def test_a_class_that_is_not_there_is_one_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert run_verb(["prove", "--class", "solo", "--out", str(tmp_path / "p")]) == 2
    told = capsys.readouterr().err
    assert told.startswith("benchctl: class 'solo': there is no such class of trials; there are nothing, moved, single")
    assert told.count("\n") == 1
    assert not (tmp_path / "p").exists()


def test_the_sparse_regression_is_refused_where_it_is_asked_for_and_not_installed(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchctl.proof.generic.arm.available", lambda: False)
    assert run_verb(["prove", "--generic", "--out", str(tmp_path / "p")]) == 2
    assert "pysindy is not installed; pip install 'benchctl[test]'" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.timeout(400)
def test_two_sealed_trials_through_the_wires(tmp_path: Path) -> None:
    out, told = tmp_path / "proof", tmp_path / "proof.json"
    asked = ("--trials", "2", "--seed", "7", "--class", "nothing", "--class", "single", "--out", out)
    ran = benchctl("prove", *asked, "--json", told, timeout_s=390.0)
    assert ran.returncode == 0, ran.stderr
    found = json.loads(told.read_text())
    assert found["trials"] == 2
    assert {row["class"]: row["right"]["of"] for row in found["classes"]} == {"nothing": 1, "single": 1}
    assert found["silent"] == 0
    assert found["false_alarms"] == 0.0
    assert found["named"] == 1.0
    assert found["peak_bytes"] < 1.5 * 2**30
    assert (found["generic"] is not None) == available()
    for digest in found["digests"]:
        assert f"sealed, sha256 {digest}" in ran.stdout
    assert (out / "confusion.png").read_bytes().startswith(b"\x89PNG")
    assert not list(out.glob("**/*.h5"))
    again = benchctl("prove", *asked, "--json", told, timeout_s=60.0)  # nothing is left to run
    assert again.returncode == 0
    assert json.loads(told.read_text())["digests"] == found["digests"]
