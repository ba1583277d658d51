"""`benchctl verify`: check that nothing has changed since it was written, and by whom it was signed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.messages import tell
from benchctl.cli.output import JsonOption, QuietOption, RecordingArgument, result_of


def verify(
    recording: RecordingArgument,
    signers: Annotated[
        Path | None,
        typer.Option("--signers", metavar="FILE", help="The keys that you accept, as OpenSSH's allowed_signers."),
    ] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Check digests; list every changed channel, attribute, step and campaign file; exit status 1 if there are any.

    If the acceptance was signed, also check its signature, and print by whom and with which key. With `--signers`, a
    missing signature and one by another key are exit status 1 too. The folder of a signed report can be checked alone.

    Example: `benchctl verify results/20261120-180000_two_stage_SIM-0001`, `benchctl verify recording.h5`,
    `benchctl verify delivered/SN-17 --signers lab/allowed_signers`
    """
    from benchctl.app.verify import verify as verified_of
    from benchctl.cli.terminal import working

    with result_of("verify", json_to, quiet) as result:
        with working(f"verifying {recording}", quiet):
            verified = verified_of(recording, signers=signers)
        result.values |= verified.values()
        if not verified.problems:
            result.say(str(verified))
            return
        for problem in verified.problems:
            tell(f"benchctl: {recording}: {problem}", err=True)
        result.fail(verified.problems[0])
