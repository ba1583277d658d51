"""What all verbs share: `--json`, `--quiet`, and a result that programs can read, also where the verb fails."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TextIO

import typer

from instruments.errors import BenchError, UsageError

JsonOption = Annotated[
    str | None, typer.Option("--json", metavar="FILE", help="Write the result for programs, `-` for stdout.")
]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no summary.")]
BenchOption = Annotated[
    str, typer.Option("--bench", metavar="BENCH", help="A bench.toml, or `simulated`, which needs no file.")
]
ParameterOption = Annotated[
    list[str] | None, typer.Option("--parameter", "-p", metavar="NAME=VALUE", help="A parameter of the procedure.")
]
SeedOption = Annotated[int | None, typer.Option("--seed", min=0, help="Draws the simulated bench's noise and errors.")]


class Result:
    """The result of a verb, filled in while it runs."""

    def __init__(self, quiet: bool) -> None:
        self.values: dict[str, Any] = {}
        self.ok = True
        self.error = ""
        self._quiet = quiet

    def say(self, text: str) -> None:
        """A line for the person at the terminal, on stdout."""
        if not self._quiet:
            tell(text)


def tell(text: str, *, err: bool = False) -> None:
    """A line on stdout or stderr; where nobody reads it any more, the work goes on all the same."""
    try:
        typer.echo(text, err=err)
    except OSError:
        let_go(sys.stderr if err else sys.stdout)


def let_go(stream: TextIO) -> None:
    """Send what is still said on a stream nowhere: its window was closed, or the reader of its pipe has gone."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


@contextmanager
def result_of(verb: str, json_to: str | None, quiet: bool) -> Iterator[Result]:
    """A `Result` that is written to `json_to` however the verb ends, as long as it ends in words."""
    if json_to not in (None, "-"):  # before any work
        if os.path.isdir(path := os.path.abspath(str(json_to))):
            raise UsageError(f"--json {json_to}: is a folder; name a file")
        if not os.access(os.path.dirname(path), os.W_OK):
            raise UsageError(f"--json {json_to}: its folder is not there or may not be written to")
    result = Result(quiet or json_to == "-")
    try:
        yield result
    except BenchError as err:
        result.ok, result.error = False, " ".join(str(err).split())
        raise
    except OSError as err:  # a name that is too long, a folder that may not be looked into
        result.ok, result.error = False, f"{err.filename or verb}: {err.strerror or err}"
        raise UsageError(result.error) from err
    finally:
        failed = sys.exc_info()[0]
        if json_to is not None and (failed is None or issubclass(failed, BenchError | typer.Exit)):
            _write(verb, json_to, result)


def parameters(texts: list[str] | None) -> dict[str, str]:
    """`NAME=VALUE` texts as a mapping.

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
            raise UsageError(f"-p {text}: {name} is given twice")
        found[name] = value
    return found


def refuse_existing(path: Path) -> None:
    """Raise `UsageError` where a file that holds something would be replaced: recordings are not made twice."""
    if path.is_file() and path.stat().st_size > 0:
        raise UsageError(f"-o {path}: is there already and is left as it is; name another file or remove it")


def _write(verb: str, json_to: str, result: Result) -> None:
    document: dict[str, Any] = {"schema": f"benchctl-{verb}/1", "ok": result.ok, **result.values}
    if not result.ok:
        document["error"] = result.error
    text = json.dumps(_plain(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    if json_to == "-":
        tell(text.rstrip())
        return
    from benchctl.atomic import whole_file

    with whole_file(Path(json_to)) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _plain(value: Any) -> Any:
    """JSON has no NaN and no infinity: they become null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
