"""Where a verb puts what it writes about a recording: looked at before any work."""

from __future__ import annotations

from pathlib import Path

from benchctl.cli.messages import tell


def beside(path: Path, ending: str) -> Path:
    """A name beside a file or a folder: its own, less the suffix, with this ending."""
    named = path if path.name not in ("", "..") else path.resolve()
    return named.with_name(named.stem + ending)


def refuse_folder(path: Path) -> None:
    """Raise `UsageError` where a folder stands in the place of a file to be written."""
    from benchctl_instruments.errors import UsageError

    if path.is_dir():
        raise UsageError(f"-o {path}: is a folder; name the file to write")


def report_folder(
    recording: Path, out: Path | None, json_to: str | None, quiet: bool, *, kind: str = "diagnosis"
) -> Path | None:
    """`out`, or the default place for a recording; None where a program asked for nothing but the JSON.

    Where that default may not be written to, a report is left out with a line on stderr if there is `--json` to answer
    by. Raises `UsageError` if there is not, or `out` may not be written to.
    """
    from benchctl.reports.results import may_be_made, results_folder
    from benchctl_instruments.errors import UsageError

    if out is None and json_to is not None and quiet:
        return None
    folder = out or results_folder(recording, kind)
    if may_be_made(folder):
        return folder
    if out is None and json_to is not None:
        tell(
            f"benchctl: {folder}: may not be written to, no report is written; name another place with --out DIR",
            err=True,
        )
        return None
    raise UsageError(f"{folder}: may not be written to; name another place for the results with --out DIR")
