"""Completion candidates for arguments and options; a file named on the command line is never executed."""

from __future__ import annotations

import ast
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import typer

_RECORDING_FILES = ("recording.h5", "campaign.h5", "recording.json")
"""A folder that contains one of these files is a recording."""

Candidate = tuple[str, str]
"""A candidate and its description. A candidate that ends in `/` or `=` is incomplete."""


def procedures_named(incomplete: str) -> list[Candidate]:
    """Return installed procedures and Python files."""
    from benchctl.plan.find import procedure_names

    found = [(name, "") for name in procedure_names() if name.startswith(incomplete)]
    return [*found, *paths(incomplete, lambda path: path.suffix == ".py")]


def parameters_of(ctx: typer.Context, incomplete: str) -> list[Candidate]:
    """Return the parameters of the procedure on the command line; after `=` their defaults."""
    procedure = str(ctx.params.get("procedure") or "")
    given = {text.partition("=")[0] for text in ctx.params.get("parameter") or ()}
    known = _parameters_in(Path(procedure)) if procedure.endswith(".py") else _parameters_of(procedure)
    name, equals, _ = incomplete.partition("=")
    if equals:
        return [(text, hint) for text, hint in known if text.startswith(incomplete) and text.startswith(f"{name}=")]
    cut = ((f"{text.partition('=')[0]}=", hint) for text, hint in known)
    return [(text, hint) for text, hint in cut if text.startswith(incomplete) and text[:-1] not in given]


def bench_files(incomplete: str) -> list[Candidate]:
    """Return the simulated bench and TOML files."""
    simulated = [("simulated", "needs no file")] if "simulated".startswith(incomplete) else []
    return [*simulated, *toml_files(incomplete)]


def toml_files(incomplete: str) -> list[Candidate]:
    """Return TOML files, and folders."""
    return paths(incomplete, lambda path: path.suffix == ".toml")


def recordings(incomplete: str) -> list[Candidate]:
    """Return recordings, campaign folders, and other folders."""
    return paths(incomplete, lambda path: path.suffix == ".h5" or _is_recording(path))


def campaigns(incomplete: str) -> list[Candidate]:
    """Return campaign folders and other folders."""
    return paths(incomplete, _is_recording)


def paths(incomplete: str, wanted: Callable[[Path], bool]) -> list[Candidate]:
    """Return the paths that begin with `incomplete` and are `wanted`, and folders, with a `/` at the end.

    Hidden ones are returned only if the typed name begins with a dot.
    """
    begun, slash, start = incomplete.rpartition("/")
    folder = Path(f"{begun}{slash}").expanduser() if slash else Path()
    found = []
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if not path.name.startswith(start) or (path.name.startswith(".") and not start.startswith(".")):
            continue
        if wanted(path):
            found.append((f"{begun}{slash}{path.name}", ""))
        elif path.is_dir():
            found.append((f"{begun}{slash}{path.name}/", ""))
    return found


def _is_recording(path: Path) -> bool:
    return any(os.path.isfile(path / name) for name in _RECORDING_FILES)


def _parameters_of(procedure: str) -> list[Candidate]:
    from benchctl.plan.find import find_procedure
    from benchctl.plan.written import as_texts

    known = find_procedure(procedure).parameters
    defaults = as_texts({one.name: one.default for one in known})
    return [(f"{one.name}={defaults[one.name]}", one.says) for one in known]


def _parameters_in(file: Path) -> list[Candidate]:
    """Return the parameters of the procedure in a file, read without executing it."""
    return [
        (f"{argument.arg}={ast.unparse(default).strip('()')}", "")
        for function in _procedures_in(ast.parse(file.read_bytes()))
        for argument, default in zip(function.args.args[::-1], function.args.defaults[::-1], strict=False)
    ][::-1]


def _procedures_in(module: ast.Module) -> Iterator[ast.FunctionDef]:
    for node in module.body:
        if isinstance(node, ast.FunctionDef) and any("procedure" in ast.unparse(one) for one in node.decorator_list):
            yield node
