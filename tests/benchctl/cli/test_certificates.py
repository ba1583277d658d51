"""Certificates that have expired, as `check` and `run` say it."""

import json
from datetime import UTC, datetime
from pathlib import Path

import pytest

from benchctl.cli.app import run_verb
from tests.benchctl.test_certificates import calibrated

BRIEF = """
from benchctl.plan import Static, procedure

@procedure()
def brief(rest_s: float = 2.0):
    '''A short rest.'''
    yield Static(duration_s=rest_s)
"""
SAYS = "chamber watlow_f4t CH-1: its certificate expired on 2020-01-31"


@pytest.fixture
def expired(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    calibrated(tmp_path, chamber="2020-01-31", digitizer="2999-12-31")
    (tmp_path / "brief.py").write_text(BRIEF)
    return tmp_path


def test_check_warns_of_it_and_does_not_refuse(expired: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["check", "brief.py", "--bench", "bench.toml", "--offline"]
    assert run_verb([*arguments, "--json", "check.json"]) == 0
    assert f"warning: {SAYS}" in capsys.readouterr().out.splitlines()
    told = json.loads((expired / "check.json").read_text())
    assert (told["ok"], told["problems"], told["warnings"]) == (True, [], [SAYS])


def test_check_of_valid_certificates_has_no_warning(expired: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["check", "brief.py", "--bench", "simulated", "--offline", "--json", "check.json"]) == 0
    assert "warning" not in capsys.readouterr().out
    assert json.loads((expired / "check.json").read_text())["warnings"] == []


def test_check_warns_of_a_certificate_that_ends_before_the_run_does(
    expired: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    today = datetime.now(UTC).date()
    calibrated(expired, digitizer=str(today))
    assert run_verb(["check", "brief.py", "--bench", "bench.toml", "--offline", "-p", "rest_s=200000"]) == 0
    (warning,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("warning")]
    assert warning.endswith(f"DI-1: its certificate expires on {today}, before the run's planned end")


def test_run_says_it_even_if_quiet_notes_it_and_goes_on(expired: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["run", "brief.py", "--bench", "bench.toml", "--out", "c", "--quiet"]) == 0
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", f"benchctl: warning: {SAYS}\n")
    events = [json.loads(line) for line in (expired / "c" / "journal.jsonl").read_text().splitlines()]
    assert [event["says"] for event in events if event["kind"] == "certificate"] == [SAYS]
