"""Certificates that do not hold for the whole of a run, before anything moves."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta

from benchctl.bench import Bench
from benchctl.campaign.check import bench_time_s
from benchctl.certificates import Expired, expired
from benchctl.plan import Plan

_LONGEST_S = 100 * 365.25 * 86400.0
"""No certificate holds for longer, and the calendar ends somewhere."""


def expiring(plan: Plan, bench: Bench, first: int = 1) -> tuple[Expired, ...]:
    """The instruments whose certificate has expired today (UTC), or will before a plan that begins now has ended.

    `first` is the step, counted from 1, with which it begins.
    """
    before = replace(plan, steps=plan.steps[: first - 1])
    left_s = (bench_time_s(plan, bench) - bench_time_s(before, bench)) / bench.time_factor
    now = datetime.now(UTC)
    ends = now + timedelta(seconds=min(left_s, _LONGEST_S))
    return expired(bench.entries, now.date(), ends.date())


def as_event(expired: Expired) -> dict[str, str]:
    """What the journal keeps of it."""
    return {
        "instrument": expired.role,
        "serial": expired.serial,
        "calibrated_until": expired.calibrated_until.isoformat(),
        "says": expired.says,
    }
