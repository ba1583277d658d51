"""From a procedure and its parameters to a plan."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike, fspath
from typing import Any

from benchctl.plan import Plan, Procedure
from benchctl.plan.find import find_procedure
from benchctl.plan.written import as_texts


def plan(procedure: str | PathLike[str] | Procedure, **parameters: Any) -> Plan:
    """The steps of a procedure with these parameters; the others keep their defaults.

    Parameters
    ----------
    procedure
        Its name (`benchctl procedures` lists them), the path of a .py file, or a function with `@procedure`.
    parameters
        Numbers, texts and sequences of numbers, in the units that the procedure's parameters name.

    Raises
    ------
    UsageError
        Where there is no such procedure or parameter, a value is of the wrong type, or they give no plan.

    Examples
    --------
    >>> from benchctl import api
    >>> plan = api.plan("static", at_c=25, duration_s=60)
    >>> [step.kind for step in plan.steps]
    ['soak', 'static']
    """
    found = procedure if isinstance(procedure, Procedure) else find_procedure(fspath(procedure))
    return found.expand(as_texts(_plain(parameters)))


def _plain(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Numpy's arrays and numbers as Python's own."""
    return {name: value.tolist() if hasattr(value, "tolist") else value for name, value in parameters.items()}
