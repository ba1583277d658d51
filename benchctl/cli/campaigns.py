"""What the verbs that run a campaign share: where it lands, and what is said of it at the end."""

from __future__ import annotations

import datetime
import re
from pathlib import Path

from benchctl.campaign.runner import Outcome
from benchctl.cli.words import duration, size


def new_folder(procedure: str, serial: str) -> Path:
    """A folder in results/ that is not there yet, named by time, procedure and unit."""
    stamp = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
    name = re.sub(r"[^A-Za-z0-9._+-]+", "-", f"{stamp}_{procedure}_{serial}")
    folder, count = Path("results") / name, 1
    while folder.exists():
        count += 1
        folder = Path("results") / f"{name}_{count}"
    return folder


def summary(outcome: Outcome) -> str:
    """The campaign in a few lines."""
    lines = [
        f"{outcome.status}: {outcome.whole} of {outcome.planned} steps whole, {outcome.samples:,} samples, "
        f"{duration(outcome.bench_time_s)} of bench time in {duration(outcome.wall_time_s)}",
        f"recording: {outcome.recording} ({size(_bytes(outcome.recording))})",
    ]
    if outcome.status != "complete":
        confirmed = "confirmed by reading back" if not outcome.safe.problems else "NOT ALL CONFIRMED"
        lines.append(
            f"bench: table at {outcome.safe.rate_dps} deg/s, chamber set to {outcome.safe.chamber_setpoint_c} °C, "
            f"{confirmed}"
        )
    return "\n".join(lines)


def _bytes(path: Path) -> int:
    return sum(file.stat().st_size for file in (path, *path.rglob("*")) if file.is_file())
