"""`benchctl run --resume`: going on with a campaign that ended early, once it is sure that it is the same one."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import typer

from benchctl.bench import Bench
from benchctl.campaign.answers import Answers
from benchctl.campaign.resume import Past, past_of, whole_steps
from benchctl.campaign.runner import AbortedError, Outcome
from benchctl.campaign.safety import SafeState
from benchctl.cli.campaigns import play
from benchctl.plan import Plan
from benchctl.recordings.recover import recover
from benchctl_instruments.errors import UsageError


def resumed(
    plan: Plan, bench: Bench, folder: Path, *, seeded: bool, yes: bool, quiet: bool, answers: Answers | None = None
) -> Outcome:
    """Go on with a campaign; one whose steps are all whole is closed where it is not, and nothing moves.

    Raises `UsageError` where it is not the same campaign, or nobody has said that the table may move.
    """
    with past_of(folder, plan, bench, seeded=seeded) as past:
        if not past.is_whole:
            if not bench.simulated and not yes:
                _ask(past)
            return play(plan, past.bench, folder, quiet=quiet, past=past, answers=answers)
        past.lock.release()
        return _closed(past)


def _ask(past: Past) -> None:
    count = len(past.plan.steps)
    next_step = past.plan.steps[past.first - 1].label
    says = (
        f"{past.folder}: {past.first - 1} of {count} steps are whole; step {past.first}, {next_step}, is next on "
        f"{past.bench.name}. The chamber will be soaked and the table will move."
    )
    if not sys.stdin.isatty():
        raise UsageError(f"--resume {says} Nobody is at the terminal to be asked: say --yes where that is safe")
    if not typer.confirm(f"{says} Is everybody clear of it?", err=True):
        raise UsageError(f"--resume {past.folder}: not confirmed; nothing has moved, and the campaign is as it was")


def _closed(past: Past) -> Outcome:
    """What a run would have told of a campaign all of whose steps are whole."""
    began_s = time.monotonic()
    closed = recover(past.folder)
    whole = len(whole_steps(past.plan, closed.steps))
    return Outcome(
        campaign=past.folder,
        recording=closed.recording,
        status=closed.status,
        planned=len(past.plan.steps),
        whole=whole,
        samples=sum(info.samples for info in closed.steps),
        bench_time_s=past.elapsed_s,
        wall_time_s=time.monotonic() - began_s,
        safe=SafeState(rate_dps=None, chamber_setpoint_c=None, problems=()),
        error=None if closed.status == "complete" else AbortedError(f"{closed.reason}; resume it once more"),
    )
