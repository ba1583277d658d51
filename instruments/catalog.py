"""Which models there are: a module in `rate_tables/`, `chambers/`, `digitizers/` or `gyros/` with a `Driver` is one.

Its simulated twin is the module of the same name in `simulated/`, with a `Twin`. Third parties add drivers through the
entry points `benchctl.instruments`, named `KIND.MODEL`, for example `chamber.acme_9000`. A chamber's model may also be
the path of a profile, a file whose name ends in `.toml`; see `instruments.chambers.profile`.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import pkgutil
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Literal

from instruments.chambers.profile_file import load_profile
from instruments.errors import UsageError

Kind = Literal["rate_table", "chamber", "digitizer", "gyro"]

_FOLDERS: dict[Kind, str] = {
    "rate_table": "rate_tables",
    "chamber": "chambers",
    "digitizer": "digitizers",
    "gyro": "gyros",
}
GROUP = "benchctl.instruments"
PROFILE = ".toml"


def models(kind: Kind) -> tuple[str, ...]:
    """The models of a kind that have a driver, sorted."""
    package = importlib.import_module(f"instruments.{_FOLDERS[kind]}")
    ours = (module.name for module in pkgutil.iter_modules(package.__path__))
    found = {name for name in ours if hasattr(importlib.import_module(f"{package.__name__}.{name}"), "Driver")}
    theirs = {point.name.partition(".")[2] for point in entry_points(group=GROUP) if point.name.startswith(f"{kind}.")}
    return tuple(sorted(found | theirs))


def driver(kind: Kind, model: str) -> Any:
    """What makes the driver; called with an address, the keyword `clock`, and the options of bench.toml.

    Raises
    ------
    UsageError
        Where no such model is known, or its profile is not there or wrong.
    """
    if model.endswith(PROFILE):
        return _with_profile(kind, model, "instruments.chambers.profiled", "ProfiledChamber")
    for point in entry_points(group=GROUP, name=f"{kind}.{model}"):
        return point.load()
    return _member(kind, model, f"instruments.{_FOLDERS[kind]}", "Driver")


def twin(kind: Kind, model: str) -> Any:
    """What makes the simulated server; called with its machine in the simulated world.

    Raises
    ------
    UsageError
        Where that model has no simulated twin, or its profile is not there or wrong.
    """
    if model.endswith(PROFILE):
        return _with_profile(kind, model, "instruments.simulated.profiled", "SimulatedProfiled")
    return _member(kind, model, "instruments.simulated", "Twin")


def _with_profile(kind: Kind, model: str, module: str, name: str) -> Any:
    """The class for chambers with a profile, with the profile in that file."""
    if kind != "chamber":
        raise UsageError(f"{kind}.model: {model!r} is a profile, and only chambers have such; {_known(kind, model)}")
    path = Path(model)
    if not _is_file(path):
        raise UsageError(f"{kind}.model: there is no profile {str(path.absolute())!r}: {_beside(path)}")
    return partial(getattr(importlib.import_module(module), name), profile=load_profile(path))


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a folder that may not be looked into, a name that is too long: reading it says so
        return True


def _beside(path: Path) -> str:
    """What stands where a profile should be."""
    names = sorted(file.name for file in path.parent.glob(f"*{PROFILE}")) if path.parent.is_dir() else []
    close = difflib.get_close_matches(path.name, names, 1)
    if close:
        return f"did you mean {close[0]}?"
    return f"that folder has {', '.join(names)}" if names else "a path is looked up from the present folder"


def _member(kind: Kind, model: str, package: str, name: str) -> Any:
    if model.isidentifier() and importlib.util.find_spec(f"{package}.{model}") is not None:
        module = importlib.import_module(f"{package}.{model}")
        if hasattr(module, name):
            return getattr(module, name)
    what = "simulated twin of" if name == "Twin" else ""
    raise UsageError(f"{kind}.model: there is no {what} {model!r}: {_known(kind, model)}".replace("  ", " "))


def _known(kind: Kind, model: str) -> str:
    """What the name of a model might have meant."""
    close = difflib.get_close_matches(model, models(kind), 1)
    return f"did you mean {close[0]}?" if close else f"there are {', '.join(models(kind))}"
