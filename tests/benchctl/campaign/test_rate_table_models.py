"""A campaign of constant rates on the simulated bench with each rate table that has no sinusoid, over its wires."""

from pathlib import Path

import numpy as np
import pytest

from benchctl.bench import Bench, load_bench
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import Outcome, run_campaign
from benchctl.plan import ConstantRate, Plan, Sine, Soak, Step
from benchctl.plan.find import find_procedure
from benchctl.recordings.reader import open_recording
from instruments.errors import BenchError

SOAK = Soak(setpoint_c=23.0, hold_s=60.0)


@pytest.fixture(params=["aerotech_ensemble", "newport_esp301"])
def bench(request: pytest.FixtureRequest) -> Bench:
    found = load_bench("simulated")
    table = found.rate_table.model_copy(update={"model": request.param, "options": {"timeout_s": 0.5}})
    return found.model_copy(update={"rate_table": table})


def run(bench: Bench, plan: Plan, folder: Path) -> Outcome:
    with open_bench(bench) as opened:
        return run_campaign(plan, opened, folder)


def plan_of(*steps: Step) -> Plan:
    return Plan(procedure="mine", parameters={}, steps=steps, calibrates=False)


def with_fault(bench: Bench, **fault: object) -> Bench:
    return Bench.model_validate({**bench.model_dump(), "faults": [{"on": "rate_table", **fault}]})


def test_a_rate_sweep_runs_to_its_end(bench: Bench, tmp_path: Path) -> None:
    short = {"at_c": "23", "soak_s": "60", "top_rate_dps": "100", "rates": "2", "run_s": "4", "zero_s": "2"}
    outcome = run(bench, find_procedure("rate_sweep").expand(short), tmp_path / "campaign")
    assert (outcome.status, outcome.error) == ("complete", None)
    assert outcome.safe.problems == ()
    assert outcome.safe.rate_dps == pytest.approx(0.0, abs=0.05)
    with open_recording(outcome.recording) as recording:
        turned = [step for step in recording.steps() if step.info.kind == "constant_rate"]
        assert {step.info.rate_dps for step in turned} >= {-100.0, -50.0, 50.0, 100.0}
        for step in turned:
            slope_dps = np.polyfit(step["time_s"], np.unwrap(step["encoder_deg"], period=360.0), 1)[0]
            assert slope_dps == pytest.approx(step.info.rate_dps, abs=0.02)


def test_a_sine_ends_the_run_with_what_can_run_instead_and_the_table_at_rest(bench: Bench, tmp_path: Path) -> None:
    outcome = run(bench, plan_of(SOAK, Sine(amplitude_dps=50.0, frequency_hz=0.5, cycles=3)), tmp_path / "campaign")
    assert outcome.status == "aborted"
    assert isinstance(outcome.error, BenchError)
    assert "an oscillation was asked for" in str(outcome.error)
    assert "rate_sweep" in str(outcome.error)
    assert outcome.safe.problems == ()


@pytest.mark.parametrize("kind", ["interlock_opened", "following_error", "restart"])
def test_a_table_that_trips_while_it_turns_ends_the_run_at_rest(bench: Bench, tmp_path: Path, kind: str) -> None:
    fault = {"kind": kind, "pattern": "FREERUN|MV", "nth": 2}
    turns = [ConstantRate(rate_dps=rate_dps, duration_s=4.0) for rate_dps in (50.0, -50.0)]
    outcome = run(with_fault(bench, **fault), plan_of(SOAK, *turns), tmp_path / "campaign")
    assert outcome.status == "aborted"
    assert outcome.whole == 2
    assert isinstance(outcome.error, BenchError)
    assert "rate_table" in str(outcome.error) or "rate table" in str(outcome.error)
    assert outcome.safe.problems == ()
    assert outcome.safe.rate_dps == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("kind", ["junk_before", "junk_in", "junk_after", "split"])
def test_an_answer_that_comes_damaged_now_and_then_costs_nothing(bench: Bench, tmp_path: Path, kind: str) -> None:
    steps = (SOAK, ConstantRate(rate_dps=50.0, duration_s=4.0))
    outcome = run(with_fault(bench, kind=kind, every=7), plan_of(*steps), tmp_path / "campaign")
    assert (outcome.status, outcome.error) == ("complete", None)
    assert outcome.safe.problems == ()
