"""A plan's timeline as lines of text: a line for each set point."""

from __future__ import annotations

from collections.abc import Iterator

from benchctl.bench import Limits
from benchctl.campaign.timing import timeline
from benchctl.cli.words import duration
from benchctl.plan import Plan, Sine, Step, ThermalRamp

_WORDS = {
    "static": "at rest",
    "constant_rate": "at constant rate",
    "sine": "sine",
    "thermal_ramp": "thermal ramp",
    "power_cycle": "powered off and on",
    "mount": "mounted by hand",
    "ask": "asked of the operator",
}


def timeline_lines(plan: Plan, limits: Limits, from_c: float) -> Iterator[str]:
    """When each set point is reached for, how long it takes, and what is run there."""
    began_s, block, last_end_s, setpoint_c = 0.0, list[Step](), 0.0, from_c
    for step, (start_s, end_s, after_c) in zip(plan.steps, timeline(plan, limits, from_c), strict=True):
        if step.kind == "soak" and block:
            yield _line(began_s, last_end_s, setpoint_c, block)
            began_s, block = start_s, []
        block.append(step)
        last_end_s, setpoint_c = end_s, after_c
    yield _line(began_s, last_end_s, setpoint_c, block)


def _line(began_s: float, end_s: float, setpoint_c: float, block: list[Step]) -> str:
    parts = [_told(kind, [step for step in block if step.kind == kind]) for kind in _WORDS]
    runs = ", ".join(part for part in parts if part) or "soak only"
    return f"{duration(began_s):>12}  {setpoint_c:+7.2f} °C  {duration(end_s - began_s):>12}  {runs}"


def _told(kind: str, steps: list[Step]) -> str:
    if not steps:
        return ""
    words = f"{len(steps)} {_WORDS[kind]}"
    top_dps = max(step.peak_rate_dps for step in steps)
    if top_dps:
        words += f" to {top_dps:g} deg/s"
    if any(isinstance(step, Sine | ThermalRamp) and step.role == "verify" for step in steps):
        words += " (kept aside)"
    return words
