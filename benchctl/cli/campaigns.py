"""What the verbs that run a campaign share: playing it, where it lands, and what is said of it at the end."""

from __future__ import annotations

import datetime
import re
from pathlib import Path
from typing import Any

from benchctl.bench import Bench
from benchctl.campaign.check import refuse_problems
from benchctl.campaign.expiry import expiring
from benchctl.campaign.guard.keeper import guarded
from benchctl.campaign.opened import open_bench
from benchctl.campaign.resume import Past
from benchctl.campaign.runner import Outcome, run_campaign
from benchctl.campaign.stop import stop_on_signals
from benchctl.cli.live import live_progress
from benchctl.cli.output import tell
from benchctl.cli.words import duration, size
from benchctl.plan import Plan
from benchctl.recordings.campaign_manifest import write_manifest
from benchctl.recordings.schema import JOURNAL, RECORDING
from instruments.errors import UsageError


def play(
    plan: Plan, bench: Bench, folder: Path, *, quiet: bool, wires: bool = True, past: Past | None = None
) -> Outcome:
    """Run a plan on a bench, or go on with its `past`, heeding signals and showing at the terminal how it goes.

    Says beforehand whose certificate does not hold so long, and writes the folder's manifest once all is closed.
    """
    refuse_problems(plan, bench, folder)
    for certificate in expiring(plan, bench, past.first if past else 1):
        tell(f"benchctl: warning: {certificate.says}", err=True)
    elapsed_s = past.elapsed_s if past else 0.0
    with (
        stop_on_signals() as stop,
        guarded(bench, folder / JOURNAL) as guard,
        open_bench(bench, wires=wires, elapsed_s=elapsed_s, purpose=f"campaign {folder.absolute()}") as opened,
        live_progress(quiet) as progress,
    ):
        outcome = run_campaign(plan, opened, folder, stop=stop, progress=progress, guard=guard, past=past)
    _seal(outcome)
    return outcome


def _seal(outcome: Outcome) -> None:
    """Write the manifest of a campaign that has its recording; a disk that refuses must not hide how the run ended."""
    if outcome.recording.name != RECORDING:
        return
    try:
        write_manifest(outcome.campaign)
    except UsageError as err:
        tell(f"benchctl: warning: the campaign has no manifest: {err}", err=True)


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
    lines += outcome.safe.remarks
    return "\n".join(lines)


def _bytes(path: Path) -> int:
    return sum(file.stat().st_size for file in (path, *path.rglob("*")) if file.is_file())
