"""`benchctl paper`: the paper's experiment, redone and audited."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.output import JsonOption, QuietOption, SeedOption, result_of


def paper(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Keep the recording and the report here.")
    ] = None,
    seed: SeedOption = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Redo the paper's experiment on a simulated VG910Q, print its table beside ours, and audit its numbers.

    Example: `benchctl paper --out paper`
    """
    with result_of("paper", json_to, quiet) as result:
        result.say("")
