"""`run --dry-run`: what would be played, how long, on how much disk; nothing moves, and nothing is written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchctl.bench import load_bench, template
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import Moment, run_campaign
from benchctl.campaign.stop import StopRequest
from benchctl.cli.app import run_verb
from benchctl.cli.next_run import preview_next
from benchctl.cli.output import Result
from benchctl.diagnosis.result import NextExperiment
from benchctl.plan.find import find_procedure

PROCEDURE = """
from benchctl.plan import Ask, ConstantRate, Soak, Static, procedure

@procedure()
def turns(run_s: float = 20.0):
    '''Two rates between zeros.'''
    yield Soak(setpoint_c=23.0, hold_s=60.0, drift_c_per_min=1.0)
    yield Static(duration_s=5.0)
    yield ConstantRate(rate_dps=90.0, duration_s=run_s)
    yield Ask(says="close the door")
    yield ConstantRate(rate_dps=-90.0, duration_s=run_s)
"""


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "turns.py").write_text(PROCEDURE)
    return tmp_path


def told(capsys: pytest.CaptureFixture[str], *arguments: str, status: int = 0) -> dict[str, Any]:
    assert run_verb(["run", *arguments, "--dry-run", "--json", "-"]) == status
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def files(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_it_says_what_check_says_and_leaves_no_trace(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = files(lab)
    found = told(capsys, "turns.py", "--bench", "simulated", "--out", "c", "-p", "run_s=0.5min")
    assert run_verb(["check", "turns.py", "--bench", "simulated", "-p", "run_s=30", "--offline", "--json", "-"]) == 0
    checked = json.loads(capsys.readouterr().out)
    shared = ("steps", "bench_time_s", "disk_bytes", "problems", "warnings", "questions")
    assert {key: found[key] for key in shared} == {key: checked[key] for key in shared}
    assert (found["ok"], found["dry_run"], found["campaign"], found["first_step"]) == (True, True, "c", 1)
    assert found["questions"] == [{"step": 4, "says": "close the door"}]
    assert files(lab) == before


def test_a_person_reads_that_nothing_was_done(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["run", "turns.py", "--bench", "simulated", "--dry-run"]) == 0
    said = capsys.readouterr().out
    assert "turns on simulated bench: 5 steps, at least" in said
    assert '"close the door" = "done"' in said
    assert "no instrument was opened, and nothing has moved or been written" in said


def test_what_check_refuses_it_refuses(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (lab / "slow.toml").write_text(template().replace("rate_dps = 300.0", "rate_dps = 50.0"))
    found = told(capsys, "turns.py", "--bench", "slow.toml", status=2)
    assert found["problems"][0]["step"] == 3
    assert "reaches 90 deg/s, the bench's limit is 50 deg/s" in found["error"]


def test_a_folder_that_holds_something_is_refused_as_by_run(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (lab / "c").mkdir()
    (lab / "c" / "mine.txt").write_text("mine")
    assert "not empty" in told(capsys, "turns.py", "--bench", "simulated", "--out", "c", status=2)["error"]


def test_at_addresses_it_opens_nothing_and_says_that_nobody_could_answer(
    lab: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nowhere = 'simulated = false\n[rate_table]\naddress = "tcp://127.0.0.1:9"\n'
    text = template().replace("simulated = true", "simulated = false")
    for table in ("rate_table", "chamber", "digitizer"):
        text = text.replace(f"[{table}]\n", f'[{table}]\naddress = "tcp://127.0.0.1:9"\n')
    assert nowhere.splitlines()[2] in text
    (lab / "real.toml").write_text(text)
    refused = told(capsys, "turns.py", "--bench", "real.toml", status=2)
    assert "step 4: ask: close the door: needs an operator, and there is none" in refused["error"]
    (lab / "answers.toml").write_text('"open the door" = "done"')
    unanswered = told(capsys, "turns.py", "--bench", "real.toml", "--answers", "answers.toml", status=2)
    assert '"close the door" = "done"' in unanswered["error"]
    (lab / "answers.toml").write_text('"close the door" = "done"')
    assert told(capsys, "turns.py", "--bench", "real.toml", "--answers", "answers.toml")["ok"]
    assert told(capsys, "static", "--bench", "real.toml")["questions"] == []


def stopped(lab: Path) -> Path:
    """A campaign of `turns` that was stopped in its third step."""
    stop = StopRequest()

    def look(moment: Moment) -> None:
        if moment.index == 3 and moment.doing == "recording":
            stop.ask("Ctrl-C")

    with open_bench(load_bench("simulated")) as opened:
        run_campaign(find_procedure("turns.py").expand(), opened, lab / "c", stop=stop, progress=look)
    return lab / "c"


def test_of_a_campaign_that_ended_early_it_says_what_is_left(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = stopped(lab)
    before = files(folder)
    found = told(capsys, "turns.py", "--bench", "simulated", "--resume", "c")
    assert (found["first_step"], found["steps"], found["campaign"]) == (3, 4, "c")  # a soak again, and what is left
    assert found["bench_time_s"] < told(capsys, "turns.py", "--bench", "simulated")["bench_time_s"]
    assert found["questions"] == [{"step": 4, "says": "close the door"}]
    assert run_verb(["run", "turns.py", "--bench", "simulated", "--resume", "c", "--dry-run"]) == 0
    assert "2 of 5 steps are complete; it would go on with step 3, rate +90" in capsys.readouterr().out
    assert {path: text for path, text in files(folder).items() if path.suffix != ".lock"} == {
        path: text for path, text in before.items() if path.suffix != ".lock"
    }
    other = told(capsys, "turns.py", "--bench", "simulated", "--resume", "c", "-p", "run_s=5", status=2)
    assert "this is not the campaign that was begun" in other["error"]
    assert run_verb(["run", "turns.py", "--bench", "simulated", "--resume", "c", "--quiet"]) == 0
    capsys.readouterr()
    assert run_verb(["run", "turns.py", "--bench", "simulated", "--resume", "c", "--dry-run"]) == 0
    assert "all 5 steps are complete; it would be closed, and nothing would move" in capsys.readouterr().out


def test_again_it_says_what_would_be_run_again(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["simulate", "static", "-o", "first.h5", "-p", "duration_s=5", "-p", "soak_s=60", "--quiet"]) == 0
    found = told(capsys, "--again", "first.h5", "--out", "again")
    assert (found["dry_run"], found["campaign"], found["first_step"]) == (True, "again", 1)
    assert sorted(path.name for path in lab.iterdir()) == ["first.h5", "turns.py"]


def test_without_settle_a_dry_run_of_a_diagnosis_is_refused(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["diagnose", "first.h5", "--dry-run"]) == 2
    assert "--dry-run: without --settle nothing is run" in capsys.readouterr().err


def test_of_the_next_experiment_it_says_the_same_and_runs_nothing(
    lab: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    following = NextExperiment(says="Run it: it tells.", procedure="static", parameters={"duration_s": 5.0})
    before = files(lab)
    result = Result(quiet=False)
    preview_next(following, load_bench("simulated"), result)
    assert result.values["dry_run"]["steps"] == 2
    assert result.values["dry_run"]["campaign"].parent == Path("results")
    said = capsys.readouterr().out
    assert "static on simulated bench: 2 steps, at least" in said
    assert files(lab) == before
