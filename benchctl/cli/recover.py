"""`benchctl recover`: close the recording of a campaign whose program crashed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.candidates import campaigns
from benchctl.cli.output import JsonOption, QuietOption, result_of


def recover(
    campaign: Annotated[
        Path, typer.Argument(metavar="CAMPAIGN", autocompletion=campaigns, help="The campaign's folder.")
    ],
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """After a crash: close the recording, mark the interrupted step, and report the complete steps. Nothing moves.

    `benchctl run … --resume` then resumes the campaign.

    Example: `benchctl recover results/20261120-180000_two_stage_SIM-0001`
    """
    from benchctl.recordings.recover import recover as close

    with result_of("recover", json_to, quiet) as result:
        closed = close(campaign)
        cut = [info for info in closed.steps if not info.whole]
        result.values |= {
            "campaign": campaign,
            "recording": closed.recording,
            "status": closed.status,
            "reason": closed.reason,
            "was_closed": closed.was_closed,
            "steps": {"whole": closed.complete, "cut": len(cut)},
            "samples": sum(info.samples for info in closed.steps),
            "unreadable": [str(file) for file in closed.unreadable],
        }
        done = "was closed before, nothing to do" if closed.was_closed else "closed"
        result.say(f"{closed.recording}: {done}; {closed.status}{f' ({closed.reason})' if closed.reason else ''}")
        result.say(f"{closed.complete} steps are complete, {len(cut)} cut")
        for info in cut:
            result.say(f"cut: step {info.index} {info.name}, {info.samples:,} samples until {info.t_end:.1f} s")
        for file in closed.unreadable:
            result.say(f"cannot be read, kept: {file}")
