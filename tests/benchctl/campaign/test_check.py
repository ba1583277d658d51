import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from benchctl.bench import load_bench
from benchctl.campaign.check import bench_time_s, problems, refuse_problems, room_problems
from benchctl.campaign.timing import disk_bytes
from benchctl.plan import ConstantRate, Plan, Sine, Soak, Static, Step, ThermalRamp
from benchctl.plan.find import find_procedure
from benchctl_instruments.errors import UsageError

BENCH = load_bench("simulated")


def _plan(*steps: Step) -> Plan:
    return Plan(procedure="mine", parameters={}, steps=steps, calibrates=False)


@pytest.mark.parametrize(
    ("step", "says"),
    [
        (ConstantRate(rate_dps=-301.0, duration_s=1.0), "reaches 301 deg/s, the bench's limit is 300 deg/s"),
        (Sine(amplitude_dps=250.0, frequency_hz=2.0, cycles=3), "reaches 3142 deg/s², the bench's limit is 1500"),
        (Soak(setpoint_c=-60.0, hold_s=1.0), "goes to -60 °C, the bench's limits are -55 to 85 °C"),
        (ThermalRamp(from_c=0.0, to_c=90.0, ramp_c_per_min=1.0), "goes to 90 °C"),
        (ThermalRamp(from_c=0.0, to_c=20.0, ramp_c_per_min=5.0), "ramps at 5 °C/min, the bench's limit is 2 °C/min"),
        (Static(duration_s=-1.0), "duration_s is -1, expected more than 0"),
        (Sine(amplitude_dps=1.0, frequency_hz=0.0, cycles=1), "frequency_hz is 0, expected more than 0"),
        (Static(duration_s=1e-4), "is too short for a single sample at 500 Hz"),
        (ThermalRamp(from_c=20.0, to_c=20.0, ramp_c_per_min=1.0), "is too short for a single sample at 500 Hz"),
    ],
)
def test_a_step_beyond_the_bench_is_named_with_the_limit(step: Step, says: str) -> None:
    found = problems(_plan(Static(duration_s=1.0), step), BENCH)
    assert [problem.step for problem in found] == [2]
    assert says in found[0].message
    with pytest.raises(UsageError, match="procedure mine, step 2: "):
        refuse_problems(_plan(Static(duration_s=1.0), step), BENCH, Path())


def test_a_problem_that_many_steps_share_is_said_once_with_how_many() -> None:
    rates = [ConstantRate(rate_dps=sign * rate, duration_s=-1.0) for rate in (299.0, 310.0, 320.0) for sign in (1, -1)]
    found = problems(_plan(Soak(setpoint_c=-60.0, hold_s=1.0), *rates), BENCH)
    assert [(one.step, one.message) for one in found] == [
        (1, "soak at -60: goes to -60 °C, the bench's limits are -55 to 85 °C (limits.coldest_c, limits.hottest_c)"),
        (2, "rate +299: duration_s is -1, expected more than 0; 5 more steps have this problem"),
    ]
    longer = [replace(rate, duration_s=9.0) for rate in rates]
    found = problems(_plan(*longer, longer[-1]), BENCH)
    assert [one.step for one in found] == [3]
    assert found[0].message.endswith("limit is 300 deg/s (limits.rate_dps); 4 more steps have this problem")
    with pytest.raises(UsageError, match=r"^procedure mine, step 3: rate \+310: reaches 310 deg/s"):
        refuse_problems(_plan(*longer), BENCH, Path())


def test_a_plan_within_the_limits_has_no_problem() -> None:
    assert problems(find_procedure("two_stage").expand(), BENCH) == []


def test_a_soak_is_reckoned_with_the_chambers_ramp() -> None:
    plan = _plan(Soak(setpoint_c=43.0, hold_s=600.0), Static(duration_s=100.0, settle_s=2.0))
    assert bench_time_s(plan, BENCH) == pytest.approx(600.0 + 20.0 / 2.0 * 60.0 + 102.0)


def test_the_main_job_takes_at_least_thirty_hours_of_bench_time_and_five_million_samples() -> None:
    plan = find_procedure("two_stage").expand()
    assert bench_time_s(plan, BENCH) > 30 * 3600
    assert sum(step.streamed_s for step in plan.steps) * 500.0 > 5e6
    assert disk_bytes(plan, 500.0) > 50e6


def test_the_disk_must_hold_the_finished_steps_the_one_being_written_twice_and_at_last_all_of_them_twice() -> None:
    scans = 1000 * 500
    one_long = _plan(Static(duration_s=1000.0))
    assert disk_bytes(one_long, 500.0) == pytest.approx(2 * 32 * scans, rel=0.01)
    many_short = _plan(*[Static(duration_s=10.0)] * 100)
    assert disk_bytes(many_short, 500.0) == pytest.approx(2 * (10 * scans + 100 * 40_000))


@pytest.mark.parametrize(
    ("free_mb", "step"), [(1.0, 1), (6.4, 1), (6.5, 2), (12.2, 7), (20.0, 13), (27.1, None)]
)  # each step needs 6.44 MB to be closed, and leaves 1.04 MB; all are gathered in as much again
def test_the_step_at_which_the_disk_would_be_full_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free_mb: float, step: int | None
) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=int(free_mb * 1e6) + (32 << 20)))
    found = room_problems(_plan(*[Static(duration_s=200.0)] * 13), BENCH, tmp_path / "results" / "c")
    assert [problem.step for problem in found] == ([] if step is None else [step])
    if step is not None:
        assert f"{free_mb:.0f} MB are free at {tmp_path}/results/c; make room" in found[0].message
        with pytest.raises(UsageError, match="static: the disk would be full: the campaign needs 27 MB"):
            refuse_problems(_plan(*[Static(duration_s=200.0)] * 13), BENCH, tmp_path / "results" / "c")


def test_what_a_campaign_has_on_the_disk_already_counts_as_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=int(5e6) + (32 << 20)))
    plan = _plan(Static(duration_s=200.0))
    assert room_problems(plan, BENCH, tmp_path)
    (tmp_path / "another.h5").write_bytes(bytes(2_000_000))
    assert room_problems(plan, BENCH, tmp_path)
    (tmp_path / "campaign.h5").touch()
    assert room_problems(plan, BENCH, tmp_path) == []


@pytest.mark.parametrize("model", ["aerotech_ensemble", "newport_esp301"])
def test_what_swings_is_named_on_a_table_without_a_sinusoid_and_what_turns_is_not(model: str) -> None:
    bench = BENCH.model_copy(update={"rate_table": BENCH.rate_table.model_copy(update={"model": model})})
    plan = _plan(
        Static(duration_s=1.0),
        ConstantRate(rate_dps=50.0, duration_s=1.0),
        ThermalRamp(from_c=0.0, to_c=20.0, ramp_c_per_min=1.0, rate_dps=10.0),
        Sine(amplitude_dps=50.0, frequency_hz=1.0, cycles=3),
        ThermalRamp(from_c=0.0, to_c=20.0, ramp_c_per_min=1.0, swing_dps=10.0),
    )
    found = problems(plan, bench)
    assert [problem.step for problem in found] == [4]
    says = f"swings, and the bench's table, {model}, has no sinusoid; take a procedure of constant rates (rate_sweep,"
    assert says in found[0].message
    assert problems(plan, BENCH) == []


def test_of_a_table_that_is_not_known_here_no_plan_is_refused() -> None:
    bench = BENCH.model_copy(update={"rate_table": BENCH.rate_table.model_copy(update={"model": "acme_9000"})})
    assert problems(_plan(Sine(amplitude_dps=50.0, frequency_hz=1.0, cycles=3)), bench) == []
