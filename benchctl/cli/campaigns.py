"""Run and resume a campaign at a terminal, and summarize it; shared by the verbs that run campaigns."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import typer

from benchctl.bench import Bench
from benchctl.campaign import playing
from benchctl.campaign.hands import Answers
from benchctl.campaign.resume import Past, past_of, whole_steps
from benchctl.campaign.runner import AbortedError, Outcome
from benchctl.campaign.safety import SafeState
from benchctl.cli.messages import duration, size, tell
from benchctl.cli.terminal import live_progress
from benchctl.plan import Plan
from benchctl.recordings.recover import recover
from benchctl_instruments.errors import UsageError


def play(
    plan: Plan,
    bench: Bench,
    folder: Path,
    *,
    quiet: bool,
    wires: bool = True,
    past: Past | None = None,
    answers: Answers | None = None,
) -> Outcome:
    """Run a plan on a bench, or resume it from its `past`, with `playing.play`; show progress at the terminal."""

    def warn(says: str) -> None:
        tell(f"benchctl: warning: {says}", err=True)

    progress = live_progress(quiet)
    return playing.play(
        plan, bench, folder, warn=warn, progress=progress, wires=wires, past=past, answers=answers, deaf_after=True
    )


def told(outcome: Outcome) -> dict[str, Any]:
    """Return the values that `--json` states for a campaign, the same for every verb."""
    return {
        "recording": outcome.recording,
        "status": outcome.status,
        "steps": {"planned": outcome.planned, "whole": outcome.whole},
        "samples": outcome.samples,
        "bench_time_s": outcome.bench_time_s,
        "wall_time_s": outcome.wall_time_s,
    }


def summary(outcome: Outcome) -> str:
    """Return a summary of the campaign in a few lines."""
    lines = [
        f"{outcome.status}: {outcome.whole} of {outcome.planned} steps complete, {outcome.samples:,} samples, "
        f"{duration(outcome.bench_time_s)} of bench time in {duration(outcome.wall_time_s)}",
        f"recording: {outcome.recording} ({size(_bytes(outcome.recording))})",
    ]
    if outcome.status != "complete" and (outcome.safe.confirmed or outcome.safe.problems):
        confirmed = "confirmed by reading back" if not outcome.safe.problems else "NOT ALL CONFIRMED"
        lines.append(
            f"bench: table at {outcome.safe.rate_dps} deg/s, chamber set to {outcome.safe.chamber_setpoint_c} °C, "
            f"{confirmed}"
        )
    lines += outcome.safe.remarks
    return "\n".join(lines)


def _bytes(path: Path) -> int:
    return sum(file.stat().st_size for file in (path, *path.rglob("*")) if file.is_file())


def resumed(
    plan: Plan, bench: Bench, folder: Path, *, seeded: bool, yes: bool, quiet: bool, answers: Answers | None = None
) -> Outcome:
    """Resume a campaign. If all its steps are complete, only close it; nothing moves.

    Raises `UsageError` if it is not the same campaign, or if the operator has not confirmed that the table may move.
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
    message = (
        f"{past.folder}: {past.first - 1} of {count} steps are whole; step {past.first}, {next_step}, is next on "
        f"{past.bench.name}. The chamber will be soaked and the table will move."
    )
    if not sys.stdin.isatty():
        raise UsageError(f"--resume {message} There is no terminal to ask at; pass --yes if that is safe")
    if not typer.confirm(f"{message} Is everybody clear of it?", err=True):
        raise UsageError(f"--resume {past.folder}: not confirmed; nothing has moved, and the campaign is as it was")


def _closed(past: Past) -> Outcome:
    """Close a campaign whose steps are all complete, and return its outcome."""
    began_s = time.monotonic()
    closed = recover(past.folder)
    complete = len(whole_steps(past.plan, closed.steps))
    return Outcome(
        campaign=past.folder,
        recording=closed.recording,
        status=closed.status,
        planned=len(past.plan.steps),
        whole=complete,
        samples=sum(info.samples for info in closed.steps),
        bench_time_s=past.elapsed_s,
        wall_time_s=time.monotonic() - began_s,
        safe=SafeState(rate_dps=None, chamber_setpoint_c=None, problems=()),
        error=None if closed.status == "complete" else AbortedError(f"{closed.reason}; resume it again"),
    )
