"""The process that does not know."""

import json
from pathlib import Path

import pytest

from benchctl.proof import blind


def test_the_answer_comes_with_its_time_and_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blind, "physics", lambda path, *told: {"path": str(path), "told": told})
    out = tmp_path / "said.json"
    assert blind.main(["there.h5", "--out", str(out), "--without", "warm_up,bias_drift", "--part", "drive"]) == 0
    found = json.loads(out.read_text())
    assert found["said"] == {"path": "there.h5", "told": [["warm_up", "bias_drift"], "drive"]}
    assert found["seconds"] >= 0
    assert found["peak_bytes"] is None or found["peak_bytes"] > 2**24


def test_a_recording_that_cannot_be_read_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert blind.main([str(tmp_path), "--arm", "generic", "--out", str(tmp_path / "said.json")]) == 2
    assert "is no recording" in capsys.readouterr().err
    assert not (tmp_path / "said.json").exists()
