"""Finding a procedure by its name or its file; benchctl knows none of them by heart.

Names come from the entry points `benchctl.procedures` (ours and third parties'); anything that ends in `.py` is a file.
"""

from __future__ import annotations

import difflib
import importlib.util
import sys
from importlib.metadata import entry_points
from pathlib import Path

from benchctl.plan.procedure import Procedure
from instruments.errors import UsageError

GROUP = "benchctl.procedures"


def procedure_names() -> tuple[str, ...]:
    """The names of all installed procedures, sorted."""
    return tuple(sorted({point.name for point in entry_points(group=GROUP)}))


def find_procedure(name: str) -> Procedure:
    """The procedure of that name, or the only one in that file.

    Raises
    ------
    UsageError
        Where there is none, or the file cannot be used.
    """
    if name.endswith(".py"):
        return _from_file(Path(name))
    for point in entry_points(group=GROUP, name=name):
        found = point.load()
        if isinstance(found, Procedure):
            return found
        raise UsageError(
            f"procedure {name}: {point.value} is {type(found).__name__}, expected a function with @procedure"
        )
    names = procedure_names()
    close = difflib.get_close_matches(name, names, 1)
    hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(names)}; a file must end in .py"
    raise UsageError(f"there is no procedure {name!r}: {hint}")


def _from_file(path: Path) -> Procedure:
    if not path.is_file():
        raise UsageError(f"procedure {path}: there is no such file")
    spec = importlib.util.spec_from_file_location(f"benchctl_procedure_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise UsageError(f"procedure {path}: not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses in it, and the source of the whole file, are looked up there
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as err:
        # Whatever a user's script raises while it is loaded is a fault of the script, told in one line.
        raise UsageError(f"procedure {path}: loading it failed: {type(err).__name__}: {err}") from err
    found = [value for value in vars(module).values() if isinstance(value, Procedure)]
    if len(found) != 1:
        raise UsageError(f"procedure {path}: expected one function with @procedure, found {len(found)}")
    return found[0]
