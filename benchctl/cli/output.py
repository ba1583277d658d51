"""Shared parts of all verbs: options, `--json`, `--quiet`, report folders, and a machine-readable result."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from benchctl.cli.candidates import bench_files, parameters_of, procedures_named, recordings, toml_files
from benchctl.cli.messages import tell
from benchctl_instruments.errors import BenchError, UsageError, reason


def toml_option(name: str, description: str) -> Any:
    """Return an option that takes a TOML file, with shell completion."""
    return typer.Option(name, metavar="FILE", autocompletion=toml_files, help=description)


def bench_option(description: str) -> Any:
    """Return the option `--bench`, with shell completion."""
    return typer.Option("--bench", metavar="BENCH", autocompletion=bench_files, help=description)


def out_option(description: str) -> Any:
    """Return the option `--out`, which takes a folder."""
    return typer.Option("--out", metavar="DIR", help=description)


JsonOption = Annotated[
    str | None, typer.Option("--json", metavar="FILE", help="Write the result for programs, `-` for stdout.")
]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no summary.")]
SeedOption = Annotated[
    int | None, typer.Option("--seed", metavar="N", min=0, help="Seed of the simulated bench's noise and errors.")
]
UnitOption = Annotated[
    str | None,
    typer.Option("--unit", metavar="SERIAL", help="Serial number of the unit; default: that of the bench."),
]
BENCH = bench_option("A bench.toml, or `simulated`, which needs no file.")
BenchOption = Annotated[str, BENCH]
ProcedureArgument = Annotated[
    str, typer.Argument(metavar="PROCEDURE", autocompletion=procedures_named, help="Its name, or a .py file.")
]
ParameterOption = Annotated[
    list[str] | None,
    typer.Option(
        "--parameter",
        "-p",
        metavar="NAME=VALUE",
        autocompletion=parameters_of,
        help="A parameter of the procedure; a number may have a unit: -p soak_s=90min.",
    ),
]
RecordingArgument = Annotated[
    Path,
    typer.Argument(
        metavar="RECORDING",
        autocompletion=recordings,
        help="A recording, a campaign's folder, or an open recording's.",
    ),
]
RecordingsArgument = Annotated[
    list[Path],
    typer.Argument(
        metavar="RECORDING",
        autocompletion=recordings,
        help="Recordings of one unit: files, campaigns' folders, or open recordings'.",
    ),
]


class Result:
    """The result of a verb, filled in while the verb runs."""

    def __init__(self, quiet: bool) -> None:
        self.values: dict[str, Any] = {}
        self.ok = True
        self.error = ""
        self.quiet = quiet

    def say(self, text: str) -> None:
        """Print a line on stdout unless `quiet`."""
        if not self.quiet:
            tell(text)

    def fail(self, error: str) -> NoReturn:
        """End the verb with exit status 1: its work is done, and does not pass."""
        self.ok, self.error = False, error
        raise typer.Exit(1)

    def say_files(self, files: Mapping[str, Path]) -> None:
        """Print the paths of written files, one line a kind."""
        for kind, path in files.items():
            self.say(f"{kind}: {path}")


@contextmanager
def result_of(verb: str, json_to: str | None, quiet: bool) -> Iterator[Result]:
    """Yield a `Result`; write it to `json_to` when the verb ends, also by a `BenchError` or an exit status.

    An unexpected exception writes nothing. Raises `UsageError` before any work if `json_to` cannot be written.
    """
    if json_to not in (None, "-"):  # before any work
        if os.path.isdir(path := os.path.abspath(str(json_to))):
            raise UsageError(f"--json {json_to}: is a folder; name a file")
        if not os.access(os.path.dirname(path), os.W_OK):
            raise UsageError(f"--json {json_to}: its folder is not there or may not be written to; name another")
    result = Result(quiet or json_to == "-")
    try:
        yield result
    except BenchError as err:
        result.ok, result.error = False, " ".join(str(err).split())
        raise
    except OSError as err:  # such as a name that is too long or a folder without read permission
        result.ok, result.error = False, f"{err.filename or verb}: {reason(err)}"
        raise UsageError(result.error) from err
    finally:
        failed = sys.exc_info()[0]
        if json_to is not None and (failed is None or issubclass(failed, BenchError | typer.Exit)):
            _write(verb, json_to, result)


def quantity_in(name: str) -> Callable[[str], float]:
    """Return a parser of command line numbers: bare in the unit that the name of the option states, or with a unit."""

    def number(text: str) -> float:
        from benchctl.units import quantity, unit_stated

        try:
            return quantity(text, unit_stated(name))
        except UsageError as err:
            raise UsageError(f"--{name.replace('_', '-')}: {err}") from err

    return number


def parameters(texts: list[str] | None) -> dict[str, str]:
    """Return `NAME=VALUE` texts as a mapping.

    Raises
    ------
    UsageError
        For a text without `=`, or a name given twice.
    """
    found: dict[str, str] = {}
    for text in texts or []:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise UsageError(f"-p {text}: expected NAME=VALUE, for example -p points=5")
        if name in found:
            raise UsageError(f"-p {text}: {name} is given twice; leave one out")
        found[name] = value
    return found


def _write(verb: str, json_to: str, result: Result) -> None:
    from benchctl.documents import json_values

    document: dict[str, Any] = {"schema": f"benchctl-{verb}/1", "ok": result.ok, **result.values}
    if not result.ok:
        document["error"] = result.error
    text = json.dumps(json_values(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    if json_to == "-":
        tell(text.rstrip())
        return
    from benchctl.atomic import whole_file

    with whole_file(Path(json_to)) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")  # a file name may not be UTF-8


def path_next_to(path: Path, ending: str) -> Path:
    """Return a path next to a file or folder: its name without the suffix, plus this ending."""
    named = path if path.name not in ("", "..") else path.resolve()
    return named.with_name(named.stem + ending)


def report_folder(
    recording: Path, out: Path | None, json_to: str | None, quiet: bool, *, kind: str = "diagnosis"
) -> Path | None:
    """Return `out`, or the default report folder of a recording; None with `--quiet --json`, which write no report.

    If the default folder is not writable, return None with `--json`, after a message on stderr. Raises `UsageError` if
    it is not writable without `--json`, or if `out` is not writable.
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
