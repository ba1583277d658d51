"""`benchctl verify`: check that nothing has changed since it was written."""

from __future__ import annotations

from pathlib import Path

import typer

from benchctl.cli.messages import tell
from benchctl.cli.output import JsonOption, QuietOption, RecordingArgument, result_of


def verify(
    recording: RecordingArgument,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Check digests; list every changed channel, attribute, step and campaign file; exit status 1 if there are any.

    Example: `benchctl verify results/20261120-180000_two_stage_SIM-0001`, `benchctl verify recording.h5`
    """
    from benchctl.recordings.campaign_manifest import manifest_digest
    from benchctl.recordings.verify import verify as problems_of

    with result_of("verify", json_to, quiet) as result:
        problems = [str(problem) for problem in problems_of(recording)]
        campaign = manifest_digest(recording)
        result.values |= {"recording": recording, "problems": problems, "campaign_digest": campaign}
        if not problems:
            result.say(f"{recording}: nothing changed since it was written{_reach(recording, campaign)}")
            return
        result.ok, result.error = False, problems[0]
        for problem in problems:
            tell(f"benchctl: {recording}: {problem}", err=True)
        raise typer.Exit(1)


def _reach(path: Path, campaign: str | None) -> str:
    """Return a text that states the extent of the check of a campaign's folder."""
    if campaign is not None:
        return f"; campaign digest {campaign}"
    return " (its steps; the campaign is not closed, and so has no manifest yet)" if path.is_dir() else ""
