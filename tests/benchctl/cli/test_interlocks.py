"""Interlocks of a bench.toml, from the command line."""

import json
from pathlib import Path

import pytest

from benchctl.bench import template
from tests.benchctl.cli.processes import benchctl, without_a_process

INTERLOCKS = """
[[interlocks]]
quantity = "gyro_v"
above = 2.0
below = -2.0

[[interlocks]]
quantity = "gyro_c"
above = 70.0
hysteresis = 2.0
for_s = 30.0
action = "hold"
give_up_s = 3600.0

[site]
"""


def _bench(folder: Path) -> Path:
    path = folder / "bench.toml"
    path.write_text(template().replace("[site]", INTERLOCKS, 1), encoding="utf-8")
    return path


def test_check_says_which_are_armed(tmp_path: Path) -> None:
    result = without_a_process("check", "static", "--bench", _bench(tmp_path), "--offline")
    assert result.returncode == 0, result.stderr
    assert (
        "interlocks: gyro_v above 2 (stop), gyro_v below -2 (stop), gyro_c above 70 for 30 s (hold)"
        in result.stdout.splitlines()
    )


@pytest.mark.slow
def test_one_that_stops_the_run_is_a_line_on_stderr_and_an_event_in_the_journal(tmp_path: Path) -> None:
    campaign = tmp_path / "campaign"
    result = benchctl("run", "rate_sweep", "--bench", _bench(tmp_path), "--out", campaign)
    assert result.returncode == 3
    (line,) = result.stderr.splitlines()
    assert line.startswith("benchctl: interlock gyro_v ")
    assert line.endswith(" was measured; find out why before the next run")
    events = [json.loads(text) for text in (campaign / "journal.jsonl").read_text(encoding="utf-8").splitlines()]
    (event,) = (event for event in events if event["kind"] == "interlock")
    assert (event["on"], event["action"]) == (True, "stop")
    assert abs(event["value"]) > 2.0
    assert event["bench_s"] > 0.0
