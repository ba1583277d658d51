"""Where a verb that judges a recording puts its report: looked at before any work."""

from __future__ import annotations

from pathlib import Path

from benchctl.cli.output import tell


def report_folder(
    recording: Path, out: Path | None, json_to: str | None, quiet: bool, *, kind: str = "diagnosis"
) -> Path | None:
    """`out`, or the default place for a recording; None where a program asked for nothing but the JSON.

    Where that default may not be written to, a report is left out with a line on stderr if there is `--json` to answer
    by. Raises `UsageError` if there is not, or `out` may not be written to.
    """
    from benchctl.reports.results import may_be_made, results_folder
    from instruments.errors import UsageError

    if out is None and json_to is not None and quiet:
        return None
    folder = out or results_folder(recording, kind)
    if may_be_made(folder):
        return folder
    if out is None and json_to is not None:
        tell(
            f"benchctl: {folder}: may not be written to: no report is written; --out DIR names another place", err=True
        )
        return None
    raise UsageError(f"{folder}: may not be written to; name another place for the results with --out DIR")
