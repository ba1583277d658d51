"""`benchctl diagnose` with its real engine: the same JSON twice, and nothing half-written where it is stopped."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from benchctl.cli.app import run_verb
from benchctl.model_file import read_model
from benchctl.recordings.reader import Recording
from benchctl.recordings.writer import write_recording
from tests.benchctl.diagnosis.made_chamber import Truth as Chamber
from tests.benchctl.diagnosis.made_chamber import chamber_channels
from tests.benchctl.diagnosis.made_drive import Truth as Drive
from tests.benchctl.diagnosis.made_drive import drive_channels
from tests.benchctl.diagnosis.made_recording import recording_of
from tests.benchctl.diagnosis.moving import KINDS, write_moving


def written(recording: Recording, path: Path) -> Path:
    write_recording(path, recording.meta, recording.steps())
    return path


def elsewhere(path: Path, out: Path, **environment: str) -> bytes:
    """The JSON of a process of its own."""
    command = [sys.executable, "-m", "benchctl", "diagnose", str(path), "--seed", "3", "--json", str(out), "--quiet"]
    subprocess.run(command, check=True, env={**os.environ, **environment}, timeout=150)
    return out.read_bytes()


@pytest.mark.slow
def test_the_same_recording_and_seed_give_the_same_json_byte_for_byte(tmp_path: Path) -> None:
    path = write_moving(tmp_path / "moving.h5", squared_v=2e-6, kinds=KINDS * 2)
    first = elsewhere(path, tmp_path / "1.json", PYTHONHASHSEED="1", OPENBLAS_NUM_THREADS="1")
    second = elsewhere(path, tmp_path / "2.json", PYTHONHASHSEED="2", OPENBLAS_NUM_THREADS="2", TZ="Asia/Tokyo")
    assert first == second
    told = json.loads(first)
    assert [one["effect"] for one in told["findings"]] == ["rate_squared"]
    assert told["seed"] == 3


def test_ctrl_c_in_the_middle_of_the_search_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tried: list[str] = []

    @contextmanager
    def impatient(quiet: bool) -> Iterator[Callable[[str, float], None]]:
        def stop(trying: str, done: float) -> None:
            tried.append(trying)
            assert 0.0 <= done <= 1.0
            if len(tried) == 5:
                raise KeyboardInterrupt

        yield stop

    monkeypatch.setattr("benchctl.cli.terminal.search_progress", impatient)
    monkeypatch.chdir(tmp_path)
    path = write_moving(tmp_path / "moving.h5")
    assert run_verb(["diagnose", str(path), "--json", "out.json", "--next", "next.py", "--out", "report"]) == 130
    assert capsys.readouterr().err.strip() == "benchctl: stopped"
    assert len(set(tried)) > 1
    assert sorted(one.name for one in tmp_path.iterdir()) == ["moving.h5"]


@pytest.mark.parametrize(
    ("part", "make", "effect", "parameter"),
    [
        ("drive", lambda: recording_of(drive_channels(Drive(coulomb=0.03), 1)), "coulomb_friction", "coulomb_nm"),
        ("chamber", lambda: recording_of(chamber_channels(Chamber(second_lag_s=30.0), 1)), "second_lag", "tau_s"),
    ],
)
@pytest.mark.slow
def test_a_part_is_diagnosed_from_the_file_to_the_page_nothing_is_made_up_and_its_model_is_read_back(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    part: str,
    make: Callable[[], Recording],
    effect: str,
    parameter: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    written(make(), tmp_path / "part.h5")
    assert run_verb(["diagnose", "part.h5", "--json", "out.json", "--out", "report"]) == 0
    told = json.loads(Path("out.json").read_text())
    assert told["part"] == part  # the recording has no gyro
    (finding,) = told["findings"]
    assert finding["effect"] == effect
    page = Path("report/diagnosis.html").read_text(encoding="utf-8")
    assert finding["says"].split(":")[0] in page
    assert "<svg" in page
    table = read_model(Path("report/model.toml")).parts[part]
    assert table["effects"][effect][parameter] == pytest.approx(finding["parameters"][parameter]["value"], rel=1e-5)
    assert (
        run_verb(["diagnose", "part.h5", "--part", part, "--model", "report/model.toml", "--json", "again.json"]) == 0
    )
    again = json.loads(Path("again.json").read_text())
    assert [one["effect"] for one in again["findings"]] == [one["effect"] for one in told["findings"]]
    assert all("was" in one for one in again["baseline"]["parameters"].values())
