"""A few of the campaigns of `tests.benchmarks.kills`: killed at a random moment, resumed, and like one that was not."""

import sys
from pathlib import Path

import pytest

from tests.benchmarks.kills import AT_REST_DPS, PLANNED, run_trial, table

CAMPAIGNS = 3


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_campaigns_that_are_killed_lose_no_step_leave_the_bench_safe_and_end_complete(tmp_path: Path) -> None:
    straight = run_trial(0, tmp_path, 20.0, None)
    assert straight["complete"], straight["said"]
    trials = [run_trial(number, tmp_path, 20.0, straight) for number in range(1, CAMPAIGNS + 1)]
    for trial in trials:
        assert trial["complete"], trial["said"]
        assert trial["verified"]
        assert trial["safe_s"] is not None
        assert trial["safe_s"] < 5.0
        if trial["killed"] and trial["begun"]:
            assert trial["opens"]
            assert trial["status"] in ("aborted", "complete")
            assert trial["steps_lost"] == 0
            assert trial["told"] <= trial["whole"] <= PLANNED
    assert any(abs(trial["moving_dps"]) > AT_REST_DPS for trial in trials)
    assert f"| campaigns killed | {sum(trial['killed'] for trial in trials)}" in table([straight, *trials])
