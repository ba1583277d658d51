"""Which models there are: a module in `rate_tables/`, `chambers/`, `digitizers/` or `gyros/` with a `Driver` is one.

Its simulated twin is the module of the same name in `simulated/`, with a `Twin`. Third parties add drivers through the
entry points `benchctl.instruments`, named `KIND.MODEL`, for example `chamber.acme_9000`. A chamber's model may also be
the path of a profile, a file whose name ends in `.toml`; see `instruments.chambers.profile`. Whoever has read the file
gives its text as well, so that a profile stays what it was when a campaign began.
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

from instruments.chambers.profile_file import parse_profile, profile_name, profile_text
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


def is_profile(model: str) -> bool:
    """Whether a chamber's model is the path of a profile."""
    return model.endswith(PROFILE)


def models(kind: Kind) -> tuple[str, ...]:
    """The models of a kind that have a driver, sorted."""
    package = importlib.import_module(f"instruments.{_FOLDERS[kind]}")
    ours = (module.name for module in pkgutil.iter_modules(package.__path__))
    found = {name for name in ours if hasattr(importlib.import_module(f"{package.__name__}.{name}"), "Driver")}
    theirs = {point.name.partition(".")[2] for point in entry_points(group=GROUP) if point.name.startswith(f"{kind}.")}
    return tuple(sorted(found | theirs))


def driver(kind: Kind, model: str, profile: str = "") -> Any:
    """What makes the driver; called with an address, the keyword `clock`, and the options of bench.toml.

    `profile` is the text of the profile that `model` names; without it that file is read.

    Raises
    ------
    UsageError
        Where no such model is known, or its profile is not there or wrong.
    """
    if is_profile(model):
        return _with_profile(kind, model, profile, "instruments.chambers.profiled", "ProfiledChamber")
    for point in entry_points(group=GROUP, name=f"{kind}.{model}"):
        return point.load()
    return _member(kind, model, f"instruments.{_FOLDERS[kind]}", "Driver")


def oscillates(model: str) -> bool:
    """Whether rate tables of that model know sinusoids; true where nothing is known: who opens one finds out."""
    try:
        return bool(getattr(driver("rate_table", model), "oscillates", True))
    except UsageError:
        return True


def twin(kind: Kind, model: str, profile: str = "") -> Any:
    """What makes the simulated server; called with its machine in the simulated world. `profile`: as for `driver`.

    Raises
    ------
    UsageError
        Where that model has no simulated twin, or its profile is not there or wrong.
    """
    if is_profile(model):
        return _with_profile(kind, model, profile, "instruments.simulated.profiled", "SimulatedProfiled")
    return _member(kind, model, "instruments.simulated", "Twin")


def find_profile(model: str, folder: Path) -> tuple[Path, str]:
    """The profile that a chamber's model names: its whole path, and its text. A relative path begins in `folder`.

    Raises
    ------
    UsageError
        Where there is no such file, or it cannot be read.
    """
    try:
        path = (folder / Path(model).expanduser()).absolute()
    except RuntimeError as err:
        raise UsageError(f"chamber.model: {model!r}: there is no such home folder; give the whole path") from err
    if not _is_file(path):
        raise UsageError(f"chamber.model: there is no profile {str(path)!r}: {_beside(path)}")
    return path, profile_text(path)


def _with_profile(kind: Kind, model: str, text: str, module: str, name: str) -> Any:
    """The class for chambers with a profile, with the profile of that text or, without one, of the present folder."""
    if kind != "chamber":
        raise UsageError(f"{kind}.model: {model!r} is a profile, and only chambers have such; {_known(kind, model)}")
    path, found = (Path(model), text) if text else find_profile(model, Path())
    return partial(getattr(importlib.import_module(module), name), profile=parse_profile(found, profile_name(path)))


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
    if names:
        return f"that folder has {', '.join(names)}"
    return f"that folder has no file that ends in {PROFILE}" if path.parent.is_dir() else "there is no such folder"


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
