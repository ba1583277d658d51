"""A run that cannot bring its bench to rest leaves that to its guard, which goes on trying."""

import json
import sys
import threading
import time
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from benchctl.app.run import play
from benchctl.bench import load_bench, template
from benchctl.campaign.opened import simulated_bench
from benchctl.cli.campaigns import at_terminal
from benchctl.plan import Plan, ThermalRamp
from benchctl_instruments.simulated.bench import SimulatedBench
from benchctl_instruments.simulated.clock import ScaledClock

SPEED = 50.0
RAMP = ThermalRamp(from_c=23.0, to_c=80.0, ramp_c_per_min=2.0, swing_dps=150.0, swing_hz=0.5)


@pytest.mark.skipif(sys.platform == "win32", reason="not tried there")
def test_a_chamber_that_is_silent_when_the_run_ends_is_sent_home_by_the_guard_once_it_answers_again(
    tmp_path: Path,
) -> None:
    with simulated_bench(load_bench("simulated"), ScaledClock(SPEED)) as servers:
        path = tmp_path / "bench.toml"
        path.write_text(_reaching(servers.addresses), encoding="utf-8")
        pulled = threading.Thread(target=_pull_the_plug_once_it_is_under_way, args=(servers,), daemon=True)
        pulled.start()
        plan = Plan(procedure="mine", parameters={}, steps=(RAMP,), calibrates=False)
        outcome = play(plan, load_bench(str(path)), tmp_path / "c", watch=at_terminal(quiet=True))
        pulled.join()
        journal = tmp_path / "c" / "journal.jsonl"
        assert outcome.status == "aborted"
        assert "the bench is not known to be at rest: chamber: " in str(outcome.error)
        assert str(outcome.error).endswith(f"; a guard process goes on trying, see {journal}")
        assert abs(servers.world.table.motion().rate_dps) < 0.05
        assert servers.world.chamber.setpoint_c() > 23.5
        servers.chamber.start()
        deadline_s = time.monotonic() + 20
        while "reason" not in (word := _last_word_of_the_guard(journal)):
            assert time.monotonic() < deadline_s, word
            time.sleep(0.05)
        assert servers.world.chamber.setpoint_c() == 23.0
    assert (word["chamber_setpoint_c"], word["problems"]) == (23.0, [])
    assert word["reason"].startswith("the runner ended without saying that the bench is at rest")


def _pull_the_plug_once_it_is_under_way(servers: SimulatedBench) -> None:
    while servers.world.chamber.setpoint_c() < 24.0:
        time.sleep(0.02)
    servers.chamber.stop()


def _last_word_of_the_guard(journal: Path) -> dict[str, Any]:
    events = map(json.loads, journal.read_text(encoding="utf-8").splitlines())
    return [event for event in events if event["kind"] == "guard"][-1]


def _reaching(addresses: dict[str, str]) -> str:
    document = tomllib.loads(template())
    document |= {"simulated": False, "time_factor": SPEED}
    del document["physics"]
    for name in ("rate_table", "chamber", "digitizer"):
        document[name]["address"] = addresses[name]
    document["digitizer"]["stream_address"] = addresses["digitizer_stream"]
    return tomli_w.dumps(document)
