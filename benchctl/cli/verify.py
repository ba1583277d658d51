"""`benchctl verify`: nothing changed since it was written."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.output import JsonOption, QuietOption, result_of


def verify(
    recording: Annotated[Path, typer.Argument(help="A recording of benchctl, or a campaign's folder.")],
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Check a recording's digests: names every channel, attribute and step that changed; exit status 1 then.

    Example: `benchctl verify recording.h5`
    """
    from benchctl.recordings.verify import verify as problems_of

    with result_of("verify", json_to, quiet) as result:
        problems = [str(problem) for problem in problems_of(recording)]
        result.values |= {"recording": recording, "problems": problems}
        if not problems:
            result.say(f"{recording}: nothing changed since it was written")
            return
        result.ok, result.error = False, problems[0]
        for problem in problems:
            typer.echo(f"benchctl: {recording}: {problem}", err=True)
        raise typer.Exit(1)
