"""`benchctl fit`: the calibration of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.output import JsonOption, QuietOption, result_of


def fit(
    recordings: Annotated[
        list[Path], typer.Argument(help="Recordings of one unit: files, campaigns' folders, or open recordings'.")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Where to write; default: beside the first recording.")
    ] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Fit the two-stage calibration and the joint one: `coefficients.json` and `report.html`.

    Example: `benchctl fit results/20261120-180000_two_stage_SIM-0001`
    """
    from benchctl.reports.fitting import fit_recordings

    with result_of("fit", json_to, quiet) as result:
        for path in recordings:
            _refuse_changed(path)
        fitted = fit_recordings(recordings, out)
        result.values |= fitted.values
        result.say(fitted.says)


def _refuse_changed(path: Path) -> None:
    """A calibration names the digest of its recording: one that no longer has it must not be fitted."""
    from benchctl.recordings.schema import RECORDING
    from benchctl.recordings.verify import verify
    from instruments.errors import UsageError

    if path.is_dir() and not (path / RECORDING).exists():
        return  # a foreign recording, or a campaign that is not finished: neither has digests
    problems = verify(path)
    if problems:
        more = f" (and {len(problems) - 1} more: benchctl verify names them)" if len(problems) > 1 else ""
        raise UsageError(f"{path}: changed since it was written, and so not fitted: {problems[0]}{more}")
