"""Find a procedure by its name or its file.

Names are those of the entry points `benchctl.procedures` of this and other packages; a name that ends in `.py` is a
file.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from importlib.machinery import SourceFileLoader
from pathlib import Path

from benchctl.closeness import meant, there_are
from benchctl.limits import cut, shown
from benchctl.plan.procedure import Procedure, fault_in
from benchctl_instruments.entry_points import leave_out, offers
from benchctl_instruments.errors import UsageError

GROUP = "benchctl.procedures"


def procedure_names() -> tuple[str, ...]:
    """Return the names of all installed procedures, sorted."""
    return tuple(offers(GROUP))


def installed_procedures() -> Iterator[tuple[str, Procedure]]:
    """Yield all installed procedures by name; skip unusable ones of other packages with a message."""
    for name in procedure_names():
        try:
            yield name, find_procedure(name)
        except UsageError as err:
            leave_out(offers(GROUP)[name], f"left out: {str(err).partition(': ')[2]}")


def find_procedure(name: str) -> Procedure:
    """Return the procedure of that name, or the only one in that file.

    Raises
    ------
    UsageError
        If there is none, or if the file, or the package that provides it, cannot be used.
    """
    if name.endswith(".py"):
        return _from_file(Path(name))
    if name in offers(GROUP):
        found = offers(GROUP)[name].load()
        if isinstance(found, Procedure):
            return found
        raise offers(GROUP)[name].refused(f"it is {type(found).__name__}, expected a function with @procedure")
    names = procedure_names()
    hint = meant(name, names, f"{there_are(names)}; a file ends in .py")
    raise UsageError(f"there is no procedure {shown(name)}: {hint}")


class _LeavesNothing(SourceFileLoader):
    """A loader that writes no `__pycache__` into the folder of a user's file."""

    def set_data(self, path: str, data: object, *, _mode: int = 0) -> None:
        """Write nothing."""


def _from_file(path: Path) -> Procedure:
    try:
        is_there = path.is_file()
    except OSError:  # the name is longer than the system allows
        is_there = False
    if not is_there:
        name = cut(str(path))
        raise UsageError(f"procedure {name}: there is no such file; benchctl procedures lists those there are")
    name = f"benchctl_procedure_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path, loader=_LeavesNothing(name, str(path)))
    if spec is None or spec.loader is None:
        raise UsageError(f"procedure {path}: is no Python file, expected one that ends in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses and `inspect` look the module up there
    try:
        spec.loader.exec_module(module)
    except BaseException as err:
        # Any exception that a user's script raises while it is loaded is a fault of the script, reported in one line.
        if isinstance(err, KeyboardInterrupt):
            raise
        raise UsageError(f"procedure {path}: cannot be loaded: {fault_in(str(path), err)}") from err
    found = [value for value in vars(module).values() if isinstance(value, Procedure)]
    if len(found) != 1:
        raise UsageError(f"procedure {path}: expected one function with @procedure, found {len(found)}")
    return found[0]
