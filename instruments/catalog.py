"""Which models there are: a module in `rate_tables/`, `chambers/` or `digitizers/` that has a `Driver` is a model.

Its simulated twin is the module of the same name in `simulated/`, with a `Twin`. Third parties add drivers through the
entry points `benchctl.instruments`, named `KIND.MODEL`, for example `chamber.acme_9000`.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import pkgutil
from importlib.metadata import entry_points
from typing import Any, Literal

from instruments.errors import UsageError

Kind = Literal["rate_table", "chamber", "digitizer"]

_FOLDERS: dict[Kind, str] = {"rate_table": "rate_tables", "chamber": "chambers", "digitizer": "digitizers"}
GROUP = "benchctl.instruments"


def models(kind: Kind) -> tuple[str, ...]:
    """The models of a kind that have a driver, sorted."""
    package = importlib.import_module(f"instruments.{_FOLDERS[kind]}")
    ours = (module.name for module in pkgutil.iter_modules(package.__path__))
    found = {name for name in ours if hasattr(importlib.import_module(f"{package.__name__}.{name}"), "Driver")}
    theirs = {point.name.partition(".")[2] for point in entry_points(group=GROUP) if point.name.startswith(f"{kind}.")}
    return tuple(sorted(found | theirs))


def driver(kind: Kind, model: str) -> Any:
    """The driver's class; called with an address, the keyword `clock`, and the options of bench.toml.

    Raises
    ------
    UsageError
        Where no such model is known.
    """
    for point in entry_points(group=GROUP, name=f"{kind}.{model}"):
        return point.load()
    return _member(kind, model, f"instruments.{_FOLDERS[kind]}", "Driver")


def twin(kind: Kind, model: str) -> Any:
    """The simulated server's class; called with its machine in the simulated world.

    Raises
    ------
    UsageError
        Where that model has no simulated twin.
    """
    return _member(kind, model, "instruments.simulated", "Twin")


def _member(kind: Kind, model: str, package: str, name: str) -> Any:
    if model.isidentifier() and importlib.util.find_spec(f"{package}.{model}") is not None:
        module = importlib.import_module(f"{package}.{model}")
        if hasattr(module, name):
            return getattr(module, name)
    close = difflib.get_close_matches(model, models(kind), 1)
    hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(models(kind))}"
    what = "simulated twin of" if name == "Twin" else ""
    raise UsageError(f"{kind}.model: there is no {what} {model!r}: {hint}".replace("  ", " "))
