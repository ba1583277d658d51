"""The plan of a campaign as its journal keeps it, so that whoever follows the run knows what is still to come.

Events of kind `plan`, each with `of` (how many steps the plan has) and a piece of them: `steps`, a list of objects with
`index` (from 1), `label`, `kind`, `t_start_s`, `t_end_s` (bench time, if the campaign is played from its beginning),
`streamed_s` (how much of that is streamed) and `setpoint_c` (at the step's end); of a soak also `hold_s`, `tolerance_c`
and `drift_c_per_min`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from benchctl.bench import Limits
from benchctl.campaign.timing import timeline
from benchctl.plan import Plan, Soak

STEPS_A_LINE = 200
"""A line of the journal stays far below what its readers take."""
SOAK = ("hold_s", "tolerance_c", "drift_c_per_min")
"""What a soak waits for."""


def plan_events(plan: Plan, limits: Limits, from_c: float) -> Iterator[dict[str, Any]]:
    """What the events of a plan say, in order; `from_c` is the set point with which it begins."""
    times = timeline(plan, limits, from_c)
    steps = [
        {
            "index": index,
            "label": step.label,
            "kind": step.kind,
            "t_start_s": round(start_s, 3),
            "t_end_s": round(end_s, 3),
            "streamed_s": round(step.streamed_s, 3),
            "setpoint_c": setpoint_c,
            **({name: getattr(step, name) for name in SOAK} if isinstance(step, Soak) else {}),
        }
        for index, (step, (start_s, end_s, setpoint_c)) in enumerate(zip(plan.steps, times, strict=True), 1)
    ]
    for first in range(0, len(steps), STEPS_A_LINE):
        yield {"of": len(steps), "steps": steps[first : first + STEPS_A_LINE]}
