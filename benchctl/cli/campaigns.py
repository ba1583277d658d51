"""Follow a campaign at a terminal, and summarize it; shared by the verbs that run campaigns."""

from __future__ import annotations

import sys
from pathlib import Path

import typer

from benchctl.app.run import Watch
from benchctl.campaign.resume import Past
from benchctl.campaign.runner import Outcome
from benchctl.cli.messages import duration, size, tell
from benchctl.cli.terminal import live_progress
from benchctl_instruments.errors import UsageError


def at_terminal(quiet: bool) -> Watch:
    """Show progress at the terminal, unless `quiet`, and warnings on stderr; a second signal is not heard."""

    def warn(message: str) -> None:
        tell(f"benchctl: warning: {message}", err=True)

    return Watch(warn=warn, progress=live_progress(quiet), deaf_after=True)


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


def ask_to_resume(past: Past) -> None:
    """Raise `UsageError` if the operator does not confirm that the table may move."""
    count = len(past.plan.steps)
    next_step = past.plan.steps[past.first - 1].label
    message = (
        f"{past.folder}: {past.first - 1} of {count} steps are complete; step {past.first}, {next_step}, is next on "
        f"{past.bench.name}. The chamber will be soaked and the table will move."
    )
    if not sys.stdin.isatty():
        raise UsageError(f"--resume {message} There is no terminal to ask at; pass --yes if that is safe")
    if not typer.confirm(f"{message} Is everybody clear of it?", err=True):
        raise UsageError(f"--resume {past.folder}: not confirmed; nothing has moved, and the campaign is as it was")
