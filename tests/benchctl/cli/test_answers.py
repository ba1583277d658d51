"""`run --answers` as CI has it: a bench served by another process, nobody at a terminal."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchctl.recordings.reader import open_recording
from tests.benchctl.campaign.by_hand import done, events
from tests.benchctl.cli.processes import simulated_servers, without_a_process

DOOR = "close the chamber's door"
OFF, ON = "switch the supply of unit SIM-0001 off", "switch the supply of unit SIM-0001 on"
PROCEDURE = f"""
from benchctl.plan import Ask, PowerCycle, Static, procedure

@procedure()
def asks():
    '''The output at rest, the door closed, and after a turn-on.'''
    yield Ask(says="{DOOR}")
    yield Static(duration_s=2.0)
    yield PowerCycle(off_s=20.0)
    yield Static(duration_s=2.0)
"""


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with the procedure, and a bench.toml that reaches a bench served by another process."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "asks.py").write_text(PROCEDURE)
    with simulated_servers(folder / "bench.toml", "--speed", "60"):
        yield folder


def benchctl(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "benchctl", *arguments],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=150,
    )


def answers(folder: Path, **by_question: str) -> None:
    lines = [f"{json.dumps(says)} = {json.dumps(answer)}" for says, answer in by_question.items()]
    (folder / "answers.toml").write_text("\n".join(lines))


@pytest.mark.slow
def test_what_check_lists_can_be_copied_into_the_file_and_then_the_plan_runs_to_its_end(lab: Path) -> None:
    checked = benchctl(lab, "check", "asks.py", "--bench", "bench.toml", "--offline")
    assert checked.returncode == 0, checked.stderr
    assert "3 questions to the operator; a file for benchctl run --answers would have these lines:" in checked.stdout
    copied = [line for line in checked.stdout.splitlines() if line.endswith(' = "done"')]
    (lab / "answers.toml").write_text("\n".join(copied))
    ran = benchctl(
        lab, "run", "asks.py", "--bench", "bench.toml", "--answers", "answers.toml", "--out", "c", "--json", "-"
    )
    assert ran.returncode == 0, ran.stderr
    assert json.loads(ran.stdout)["steps"] == {"planned": 4, "whole": 4}
    assert done(lab / "c") == [DOOR, "supply off", "supply on"]
    assert {event["by"] for event in events(lab / "c", "operator")} == {"the answers of answers.toml"}
    with open_recording(lab / "c") as recording:
        assert [info.kind for info in recording.infos] == ["ask", "static", "power_cycle", "static"]


def test_a_file_without_every_answer_is_refused_before_anything_moves(lab: Path) -> None:
    answers(lab, **{DOOR: "done", OFF: "done"})
    refused = without_a_process(
        *("run", "asks.py", "--bench", "bench.toml", "--answers", "answers.toml", "--out", "refused"), folder=lab
    )
    assert refused.returncode == 2
    assert len(refused.stderr.strip().splitlines()) == 1
    assert f'"{ON}" = "done"' in refused.stderr
    assert not (lab / "refused").exists()


@pytest.mark.slow
def test_a_refusal_ends_the_run_with_the_bench_at_rest(lab: Path) -> None:
    answers(lab, **{DOOR: "done", OFF: "refuse", ON: "done"})
    ran = benchctl(lab, "run", "asks.py", "--bench", "bench.toml", "--answers", "answers.toml", "--out", "r")
    assert ran.returncode == 3
    assert f"stopped by the answers of answers.toml: refused to {OFF}" in ran.stderr
    assert done(lab / "r") == [DOOR]
    (safe,) = events(lab / "r", "safe")
    assert (safe["status"], safe["problems"]) == ("interrupted", [])
    with open_recording(lab / "r") as recording:
        assert (recording.meta.status, [info.whole for info in recording.infos]) == ("interrupted", [True, True, False])


@pytest.mark.slow
def test_the_simulated_bench_does_it_by_itself_unless_the_file_refuses(lab: Path) -> None:
    answers(lab, **{DOOR: "refuse", OFF: "done", ON: "done"})
    by_itself = benchctl(lab, "run", "asks.py", "--bench", "simulated", "--out", "s")
    assert by_itself.returncode == 0, by_itself.stderr
    refused = benchctl(lab, "run", "asks.py", "--bench", "simulated", "--answers", "answers.toml", "--out", "t")
    assert refused.returncode == 3
    assert f"refused to {DOOR}" in refused.stderr
