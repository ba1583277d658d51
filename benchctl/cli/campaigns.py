"""What the verbs that run a campaign share: playing it at a terminal, and what is said of it at the end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchctl.bench import Bench
from benchctl.campaign import playing
from benchctl.campaign.answers import Answers
from benchctl.campaign.resume import Past
from benchctl.campaign.runner import Outcome
from benchctl.cli.live import live_progress
from benchctl.cli.saying import tell
from benchctl.cli.words import duration, size
from benchctl.plan import Plan


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
    """Run a plan on a bench, or go on with its `past`, as `playing.play` does, telling at the terminal how it goes."""

    def warn(says: str) -> None:
        tell(f"benchctl: warning: {says}", err=True)

    progress = live_progress(quiet)
    return playing.play(
        plan, bench, folder, warn=warn, progress=progress, wires=wires, past=past, answers=answers, deaf_after=True
    )


def told(outcome: Outcome) -> dict[str, Any]:
    """What `--json` says of a campaign, whichever verb ran it."""
    return {
        "recording": outcome.recording,
        "status": outcome.status,
        "steps": {"planned": outcome.planned, "whole": outcome.whole},
        "samples": outcome.samples,
        "bench_time_s": outcome.bench_time_s,
        "wall_time_s": outcome.wall_time_s,
    }


def summary(outcome: Outcome) -> str:
    """The campaign in a few lines."""
    lines = [
        f"{outcome.status}: {outcome.whole} of {outcome.planned} steps whole, {outcome.samples:,} samples, "
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
