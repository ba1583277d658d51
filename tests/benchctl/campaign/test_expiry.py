import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from benchctl.bench import Bench, load_bench
from benchctl.campaign.check import expiring
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import run_campaign
from benchctl.plan import Plan, Soak, Static, Step
from benchctl.recordings.reader import open_recording
from benchctl.recordings.stated import expired_of
from tests.benchctl.test_certificates import CERTIFIED, bench_with, calibrated

DAY_S = 86400.0


def _plan(*steps: Step) -> Plan:
    return Plan(procedure="mine", parameters={}, steps=steps, calibrates=False)


def _in_days(days: int) -> str:
    return str((datetime.now(UTC) + timedelta(days=days)).date())


def _events(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "journal.jsonl").read_text(encoding="utf-8").splitlines()]


def _roles(plan: Plan, bench: Bench, first: int = 1) -> list[str]:
    return [each.role for each in expiring(plan, bench, first)]


def test_a_certificate_must_hold_until_the_plans_end(tmp_path: Path) -> None:
    bench = calibrated(tmp_path, rate_table=_in_days(-1), chamber=_in_days(1), digitizer=_in_days(6))
    assert _roles(_plan(Static(duration_s=60.0)), bench) == ["rate_table"]
    days = _plan(Static(duration_s=60.0), Static(duration_s=3 * DAY_S))
    assert _roles(days, bench) == ["rate_table", "chamber"]


def test_only_what_is_left_of_a_plan_counts_and_at_the_benchs_speed(tmp_path: Path) -> None:
    bench = calibrated(tmp_path, chamber=_in_days(1))
    plan = _plan(Static(duration_s=3 * DAY_S), Static(duration_s=60.0))
    assert _roles(plan, bench) == ["chamber"]
    assert _roles(plan, bench, first=2) == []
    assert _roles(plan, bench.model_copy(update={"time_factor": 100.0})) == []


def test_a_plan_without_an_end_is_longer_than_any_certificate(tmp_path: Path) -> None:
    bench = calibrated(tmp_path, chamber=_in_days(3650))
    assert _roles(_plan(Soak(setpoint_c=23.0, hold_s=1e15)), bench) == ["chamber"]


def test_a_run_notes_an_expired_certificate_before_anything_moves_and_its_recording_tells_it(tmp_path: Path) -> None:
    bench = calibrated(tmp_path, chamber="2020-01-31")
    with open_bench(bench, wires=False) as opened:
        outcome = run_campaign(_plan(Static(duration_s=2.0)), opened, tmp_path / "c")
    events = _events(tmp_path / "c")
    kinds = [event["kind"] for event in events]
    assert kinds.index("certificate") < kinds.index("prepared")
    (event,) = [event for event in events if event["kind"] == "certificate"]
    assert (event["instrument"], event["serial"], event["calibrated_until"]) == ("chamber", "CH-1", "2020-01-31")
    assert event["says"] == "chamber watlow_f4t CH-1: its certificate expired on 2020-01-31"
    with open_recording(outcome.recording) as recording:
        (found,) = expired_of(recording.meta)
    assert (found.role, found.serial, str(found.calibrated_until)) == ("chamber", "CH-1", "2020-01-31")


def test_a_recording_keeps_the_numbers_of_the_certificates(tmp_path: Path) -> None:
    with open_bench(load_bench(bench_with(tmp_path, CERTIFIED)), wires=False) as opened:
        outcome = run_campaign(_plan(Static(duration_s=2.0)), opened, tmp_path / "c")
    with open_recording(outcome.recording) as recording:
        told = json.loads(recording.meta.provenance["instruments"])
    assert {role: each["certificate"] for role, each in told.items()} == {
        "rate_table": "LNE 2026-123", "chamber": "", "digitizer": "",
    }  # fmt: skip
    assert "certificate" not in [event["kind"] for event in _events(tmp_path / "c")]
