"""Catalog of instrument models: a module in `rate_tables/`, `chambers/`, `digitizers/` or `gyros/` with a `Driver`.

The simulated twin of a model is the class `Twin` in the module of the same name in `simulated/`. Other packages add
drivers through the entry points `benchctl.instruments`, named `KIND.MODEL`, for example `chamber.acme_9000`, and twins
through `benchctl.simulated` under the same name; they cannot replace a built-in model. A chamber's model may also be
the path of a profile, a file whose name ends in `.toml`; see `chambers.profile`. A caller that has read this file
passes its text too, so that the profile stays as it was when a campaign began.

A driver is called with an address, the keyword `clock` and the options of bench.toml, and implements the protocol of
its kind in `interfaces`. It may declare how its instrument is recognised, see `recognition`. A twin is called with its
machine (`simulated.machines`) and the options that it accepts; it has `address` and is a context manager that serves
while it is entered. If its link supports simulated faults, it has the attribute `faults`, initially None, which
`benchctl_instruments.simulated.tcp_server` plays.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import math
import pkgutil
from functools import partial
from pathlib import Path
from typing import Any, Literal

from benchctl_instruments.chambers.profile import parse_profile, profile_name, profile_text
from benchctl_instruments.entry_points import Offer, leave_out_clash, offers
from benchctl_instruments.errors import UsageError

Kind = Literal["rate_table", "chamber", "digitizer", "gyro"]

_FOLDERS: dict[Kind, str] = {
    "rate_table": "rate_tables",
    "chamber": "chambers",
    "digitizer": "digitizers",
    "gyro": "gyros",
}
DRIVERS, TWINS = "benchctl.instruments", "benchctl.simulated"
PROFILE = ".toml"
MANUAL = "manual"
"""The model of a rate table without a wire: an operator sets its rates."""


def is_profile(model: str) -> bool:
    """Return whether a chamber's model is the path of a profile."""
    return model.endswith(PROFILE)


def models(kind: Kind) -> tuple[str, ...]:
    """Return the sorted models of a kind that have a driver: the built-in ones and those that other packages add."""
    theirs = (name.partition(".")[2] for name in offers(DRIVERS) if name.startswith(f"{kind}."))
    return tuple(sorted({*our_models(kind), *theirs}))


def our_models(kind: Kind) -> tuple[str, ...]:
    """Return the sorted built-in models of a kind."""
    package = importlib.import_module(f"benchctl_instruments.{_FOLDERS[kind]}")
    names = (module.name for module in pkgutil.iter_modules(package.__path__))
    return tuple(sorted(name for name in names if _member(name, package.__name__, "Driver") is not None))


def driver(kind: Kind, model: str, profile: str = "") -> Any:
    """Return the factory of the driver; call it with an address, the keyword `clock` and the options of bench.toml.

    `profile` is the text of the profile that `model` names; if it is empty, the file is read.

    Raises
    ------
    UsageError
        If the model is unknown, its profile is missing or invalid, or the package that adds it cannot be used.
    """
    if is_profile(model):
        return _with_profile(kind, model, profile, "benchctl_instruments.chambers.profiled", "ProfiledChamber")
    ours = _member(model, f"benchctl_instruments.{_FOLDERS[kind]}", "Driver")
    found = _chosen(ours, offers(DRIVERS).get(f"{kind}.{model}"))
    if found is None:
        raise UsageError(f"{kind}.model: there is no {model!r}: {_known(kind, model)}")
    return found


def oscillates(model: str) -> bool:
    """Return whether rate tables of this model support sinusoids; True if that is unknown until the table is opened."""
    try:
        return bool(getattr(driver("rate_table", model), "oscillates", True))
    except UsageError:
        return True


def homes(model: str) -> bool:
    """Return whether rate tables of this model can be homed; True if that is unknown until the table is opened."""
    try:
        return hasattr(driver("rate_table", model), "home")
    except UsageError:
        return True


def counts_encoder(model: str) -> bool:
    """Return whether digitizers of this model have an input for an encoder; True if the model is unknown."""
    return bool(_of_digitizer(model, "counts_encoder", True))


def fastest_hz(model: str) -> float:
    """Return the highest scan rate of digitizers of this model [Hz]; infinite if the driver does not state it."""
    return float(_of_digitizer(model, "FASTEST_HZ", math.inf))


def _of_digitizer(model: str, name: str, usual: object) -> Any:
    try:
        return getattr(driver("digitizer", model), name, usual)
    except UsageError:
        return usual


def twin(kind: Kind, model: str, profile: str = "") -> Any:
    """Return the factory of the simulated server; call it with its machine. `profile` is as for `driver`.

    Raises
    ------
    UsageError
        If the model has no simulated twin, its profile is missing or invalid, or the package that adds it cannot be
        used.
    """
    if is_profile(model):
        return _with_profile(kind, model, profile, "benchctl_instruments.simulated.profiled", "SimulatedProfiled")
    name = f"{kind}.{model}"
    found = _chosen(_member(model, "benchctl_instruments.simulated", "Twin"), offers(TWINS).get(name))
    if found is None:
        adds = offers(DRIVERS).get(name)
        why = f"package {adds.package} adds its driver and no {TWINS}" if adds else _known(kind, model)
        raise UsageError(f"{kind}.model: there is no simulated twin of {model!r}: {why}")
    return found


def find_profile(model: str, folder: Path) -> tuple[Path, str]:
    """Return the absolute path and the text of a chamber model's profile; a relative path starts in `folder`.

    Raises
    ------
    UsageError
        If the file does not exist or cannot be read.
    """
    try:
        path = (folder / Path(model).expanduser()).absolute()
    except RuntimeError as err:
        raise UsageError(f"chamber.model: {model!r}: there is no such home folder; give the complete path") from err
    if not _is_file(path):
        raise UsageError(f"chamber.model: there is no profile {str(path)!r}: {_beside(path)}")
    return path, profile_text(path)


def _with_profile(kind: Kind, model: str, text: str, module: str, name: str) -> Any:
    """Return the class with the profile parsed from `text` or, if that is empty, from a file in the current folder."""
    if kind != "chamber":
        raise UsageError(f"{kind}.model: {model!r} is a profile, and only chambers have such; {_known(kind, model)}")
    path, found = (Path(model), text) if text else find_profile(model, Path())
    return partial(getattr(importlib.import_module(module), name), profile=parse_profile(found, profile_name(path)))


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # no permission for the folder, or the name is too long: reading the file reports it
        return True


def _beside(path: Path) -> str:
    """Describe which profiles the folder contains instead of the missing one."""
    names = sorted(file.name for file in path.parent.glob(f"*{PROFILE}")) if path.parent.is_dir() else []
    close = difflib.get_close_matches(path.name, names, 1)
    if close:
        return f"did you mean {close[0]}?"
    if names:
        return f"that folder has {', '.join(names)}"
    return f"that folder has no file that ends in {PROFILE}" if path.parent.is_dir() else "there is no such folder"


def _member(model: str, package: str, name: str) -> Any:
    """Return the attribute `name` of the built-in module of a model, or None."""
    if not model.isidentifier() or importlib.util.find_spec(f"{package}.{model}") is None:
        return None
    return getattr(importlib.import_module(f"{package}.{model}"), name, None)


def _chosen(ours: Any, offer: Offer | None) -> Any:
    """Return the built-in class, or the one that another package adds, or None."""
    if offer is None:
        return ours
    if ours is not None:
        leave_out_clash(offer)
        return ours
    found = offer.load()
    if not callable(found):
        raise offer.refused(f"it is {found!r}, expected a class")
    return found


def _known(kind: Kind, model: str) -> str:
    """Suggest the closest known model, or list the known models."""
    close = difflib.get_close_matches(model, models(kind), 1)
    return f"did you mean {close[0]}?" if close else f"there are {', '.join(models(kind))}"
