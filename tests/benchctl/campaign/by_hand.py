"""A plan that a person has a hand in, and what its journal says of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from benchctl.bench import load_bench
from benchctl.plan import ConstantRate, Mount, Plan, PowerCycle, Soak, Static, Step

SOAK = Soak(setpoint_c=23.0, hold_s=60.0, drift_c_per_min=1.0)
ACROSS, ALONG = Mount(position="across"), Mount(position="along")
TURNS = (ConstantRate(rate_dps=90.0, duration_s=8.0), ConstantRate(rate_dps=-90.0, duration_s=8.0, role="verify"))
REST = Static(duration_s=5.0)
STEPS: tuple[Step, ...] = (SOAK, REST, PowerCycle(off_s=75.0), REST, ACROSS, *TURNS, ALONG, REST)

BENCH = load_bench("simulated")

PROCEDURE = """
from benchctl.plan import ConstantRate, Mount, PowerCycle, Static, procedure

@procedure()
def by_hand():
    '''A power cycle, and the misalignment.'''
    yield PowerCycle(off_s=40.0)
    yield Static(duration_s=5.0)
    yield Mount(position="across")
    yield ConstantRate(rate_dps=90.0, duration_s=8.0)
    yield ConstantRate(rate_dps=-90.0, duration_s=8.0)
    yield Mount(position="along")
    yield Static(duration_s=5.0)
"""


def plan_of(*steps: Step) -> Plan:
    return Plan(procedure="mine", parameters={}, steps=steps, calibrates=False, source="source")


PLAN = plan_of(*STEPS)


def events(folder: Path, kind: str) -> list[dict[str, Any]]:
    lines = [json.loads(line) for line in (folder / "journal.jsonl").read_text(encoding="utf-8").splitlines()]
    return [line for line in lines if line["kind"] == kind]


def done(folder: Path) -> list[str]:
    return [event["says"] for event in events(folder, "operator")]
