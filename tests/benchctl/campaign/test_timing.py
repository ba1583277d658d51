"""How long steps take that a person does."""

import pytest

from benchctl.bench import load_bench
from benchctl.campaign.check import bench_time_s, problems
from benchctl.campaign.timing import BYTES_PER_STEP, OPERATOR_S, disk_bytes, set_point_after, step_s, timeline
from benchctl.cli.dry_run import timeline_lines
from benchctl.plan import ConstantRate, Mount, Plan, PowerCycle, Soak

BENCH = load_bench("simulated")
STEPS = (
    Soak(setpoint_c=23.0, hold_s=60.0),
    PowerCycle(off_s=90.0),
    Mount(position="across"),
    ConstantRate(rate_dps=60.0, duration_s=12.0),
)
PLAN = Plan(procedure="mine", parameters={}, steps=STEPS, calibrates=False)


def test_a_power_cycle_takes_as_long_as_it_is_off_and_a_mount_as_long_as_somebody_needs() -> None:
    assert step_s(PowerCycle(off_s=90.0), 23.0, BENCH.limits) == 90.0
    assert step_s(Mount(position="along"), 23.0, BENCH.limits) == OPERATOR_S == 120.0
    assert set_point_after(Mount(position="along"), -40.0) == -40.0
    ends_s = [end_s for _, end_s, _ in timeline(PLAN, BENCH.limits, 23.0)]
    assert ends_s[:3] == [60.0, 150.0, 270.0]
    assert bench_time_s(PLAN, BENCH) == pytest.approx(270.0 + 14.16)


def test_they_are_no_problem_for_a_bench_and_take_what_a_step_takes_on_the_disk() -> None:
    assert problems(PLAN, BENCH) == []
    alone = Plan(procedure="mine", parameters={}, steps=STEPS[1:3], calibrates=False)
    assert disk_bytes(alone, 500.0) == 4 * BYTES_PER_STEP
    faulty = Plan(procedure="mine", parameters={}, steps=(PowerCycle(off_s=-1.0),), calibrates=False)
    assert [one.message for one in problems(faulty, BENCH)] == ["power cycle: off_s is -1, expected more than 0"]


def test_the_timeline_names_them() -> None:
    (line,) = timeline_lines(PLAN, BENCH.limits, 23.0)
    assert line.endswith("1 at constant rate to 60 deg/s, 1 powered off and on, 1 mounted by an operator")
