"""The plan in the journal: in pieces that fit into lines, as those who follow the run read it again."""

import json

from benchctl.bench import load_bench
from benchctl.campaign.timing import SOAK, STEPS_A_LINE, plan_events, timeline
from benchctl.limits import MOST_LINE_BYTES
from benchctl.plan import ConstantRate, Plan, Soak, Step, ThermalRamp

LIMITS = load_bench("simulated").limits


def _plan(*steps: Step) -> Plan:
    return Plan(procedure="mine", parameters={}, steps=steps, calibrates=False, source="")


def test_a_short_plan_is_one_event_with_the_times_of_the_timeline() -> None:
    plan = _plan(
        Soak(setpoint_c=40.0, hold_s=600.0),
        ConstantRate(rate_dps=-20.0, duration_s=30.0),
        ThermalRamp(from_c=40.0, to_c=30.0, ramp_c_per_min=1.0),
    )
    (event,) = plan_events(plan, LIMITS, 23.0)
    assert event["of"] == 3
    times = [(round(a, 3), round(b, 3), c) for a, b, c in timeline(plan, LIMITS, 23.0)]
    assert [(step["t_start_s"], step["t_end_s"], step["setpoint_c"]) for step in event["steps"]] == times
    assert [(step["index"], step["label"], step["kind"], step["streamed_s"]) for step in event["steps"]] == [
        (1, "soak at +40", "soak", 0.0),
        (2, "rate -20", "constant_rate", 30.0),
        (3, "ramp to +30", "thermal_ramp", 600.0),
    ]


def test_a_soak_says_what_it_waits_for() -> None:
    soak = Soak(setpoint_c=40.0, hold_s=600.0, tolerance_c=0.2, drift_c_per_min=0.05)
    (event,) = plan_events(_plan(soak, ConstantRate(rate_dps=1.0, duration_s=1.0)), LIMITS, 23.0)
    assert [event["steps"][0][name] for name in SOAK] == [600.0, 0.2, 0.05]
    assert SOAK[0] not in event["steps"][1]


def test_a_long_plan_is_cut_into_lines_that_readers_take() -> None:
    plan = _plan(*(ConstantRate(rate_dps=1.0, duration_s=1.0) for _ in range(2 * STEPS_A_LINE + 1)))
    events = list(plan_events(plan, LIMITS, 23.0))
    assert [len(event["steps"]) for event in events] == [STEPS_A_LINE, STEPS_A_LINE, 1]
    assert [step["index"] for event in events for step in event["steps"]] == list(range(1, 2 * STEPS_A_LINE + 2))
    assert max(len(json.dumps(event)) for event in events) < MOST_LINE_BYTES // 10


def test_an_empty_plan_is_no_event() -> None:
    assert list(plan_events(_plan(), LIMITS, 23.0)) == []
