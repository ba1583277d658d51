"""A campaign of constant rates on the simulated bench with each rate table that has no sinusoid, over its wires."""

import re
from pathlib import Path

import numpy as np
import pytest

from benchctl.bench import Bench, Interlock, load_bench
from benchctl.campaign.opened import OpenBench, open_bench
from benchctl.campaign.runner import Moment, Outcome, run_campaign
from benchctl.plan import ConstantRate, Plan, Sine, Soak, Step, ThermalRamp
from benchctl.plan.find import find_procedure
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import BenchError, SafetyError, UsageError

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


@pytest.mark.parametrize(
    "swinging",
    [
        Sine(amplitude_dps=50.0, frequency_hz=0.5, cycles=3),
        ThermalRamp(from_c=23.0, to_c=25.0, ramp_c_per_min=1.0, swing_dps=20.0),
    ],
)
def test_a_plan_that_swings_is_refused_before_anything_moves(bench: Bench, tmp_path: Path, swinging: Step) -> None:
    turn = ConstantRate(rate_dps=50.0, duration_s=4.0)
    with pytest.raises(UsageError, match=rf"step 3: .*: swings, and the bench's table, {bench.rate_table.model}, has"):
        run(bench, plan_of(SOAK, turn, swinging), tmp_path / "campaign")
    assert not (tmp_path / "campaign").exists()


class Runaway:
    """A drive that keeps no ramp: from some moment on it takes another one, and goes `to_dps` by itself."""

    def __init__(self, opened: OpenBench, doing: str, ramp_dps2: float, to_dps: float | None) -> None:
        assert opened.simulated is not None
        self._table, self._doing, self._to_dps = opened.simulated.world.table, doing, to_dps
        self._ramp_dps2 = ramp_dps2
        self._keep_limits = self._table.set_limits

    def __call__(self, moment: Moment) -> None:
        if moment.doing != self._doing or (self._to_dps is not None and not moment.samples):
            return
        self._doing = ""
        self._table.set_limits = self._keep_no_ramp  # type: ignore[method-assign]
        if self._to_dps is not None:
            self._keep_no_ramp(400.0, 0.0)
            self._table.demand_rate(self._to_dps)

    def _keep_no_ramp(self, rate_dps: float, acceleration_dps2: float) -> None:
        self._keep_limits(rate_dps, self._ramp_dps2)


def run_away(bench: Bench, folder: Path, doing: str, ramp_dps2: float = 5000.0, to_dps: float | None = None) -> Outcome:
    with open_bench(bench) as opened:
        turn = ConstantRate(rate_dps=200.0, duration_s=20.0)
        runaway = Runaway(opened, doing, ramp_dps2, to_dps)
        outcome = run_campaign(plan_of(SOAK, turn), opened, folder, progress=runaway)
    assert outcome.status == "aborted"
    assert isinstance(outcome.error, SafetyError)
    assert outcome.safe.problems == ()
    assert outcome.safe.rate_dps == pytest.approx(0.0, abs=0.05)
    return outcome


def test_a_drive_that_spins_up_faster_than_the_limit_is_stopped_by_its_own_rates(bench: Bench, tmp_path: Path) -> None:
    outcome = run_away(bench, tmp_path / "campaign", "spinning up")
    said = re.fullmatch(
        r"rate_table: \+(\d+) deg/s² measured, the bench's limit is 1500 deg/s²; "
        "find out why before the next run",
        str(outcome.error),
    )
    assert said is not None
    assert 1575.0 < float(said[1]) < 5000.0


def test_a_table_that_jolts_while_it_is_recorded_is_stopped_by_the_encoder(bench: Bench, tmp_path: Path) -> None:
    outcome = run_away(bench, tmp_path / "campaign", "recording", to_dps=50.0)  # within the limit of the rate
    said = re.fullmatch(
        r"rate_table: -(\d+) deg/s² measured by the encoder, the bench's limit is 1500 deg/s²; "
        "find .*",
        str(outcome.error),
    )
    assert said is not None
    assert 1575.0 < float(said[1]) < 5000.0


def test_an_interlock_on_the_acceleration_trips_while_the_table_spins_up(bench: Bench, tmp_path: Path) -> None:
    limited = bench.model_copy(update={"interlocks": (Interlock(quantity="acceleration_dps2", above=800.0),)})
    turn = ConstantRate(rate_dps=200.0, duration_s=4.0)
    outcome = run(limited, plan_of(SOAK, turn), tmp_path / "campaign")
    assert isinstance(outcome.error, SafetyError)
    assert str(outcome.error).startswith("interlock acceleration_dps2 above 800: ")
    assert outcome.safe.problems == ()


def test_an_interlock_on_the_acceleration_trips_while_the_table_is_recorded(bench: Bench, tmp_path: Path) -> None:
    limited = bench.model_copy(update={"interlocks": (Interlock(quantity="acceleration_dps2", below=-1000.0),)})
    outcome = run_away(limited, tmp_path / "campaign", "recording", ramp_dps2=1400.0, to_dps=50.0)
    assert str(outcome.error).startswith("interlock acceleration_dps2 by the encoder below -1000: ")


def test_a_rate_that_is_kept_is_no_acceleration(bench: Bench, tmp_path: Path) -> None:
    """Rounding and the encoder's own errors, at 300 deg/s, and a spin-up with all that the limit allows."""
    interlock = Interlock(quantity="acceleration_dps2", above=1575.0, below=-1575.0)
    limited = bench.model_copy(update={"interlocks": (interlock,)})
    turns = [ConstantRate(rate_dps=rate_dps, duration_s=10.0) for rate_dps in (300.0, -300.0)]
    outcome = run(limited, plan_of(SOAK, *turns), tmp_path / "campaign")
    assert (outcome.status, outcome.error) == ("complete", None)


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
