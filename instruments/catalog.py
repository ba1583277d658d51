"""Which models there are: a module in `rate_tables/`, `chambers/`, `digitizers/` or `gyros/` with a `Driver` is one.

Its simulated twin is the module of the same name in `simulated/`, with a `Twin`. Other packages add drivers through the
entry points `benchctl.instruments`, named `KIND.MODEL`, for example `chamber.acme_9000`, and twins through
`benchctl.simulated` under the same name; none of them takes the place of one of ours. A chamber's model may also be the
path of a profile, a file whose name ends in `.toml`; see `chambers.profile`. Whoever has read the file
gives its text as well, so that a profile stays what it was when a campaign began.

A driver is called with an address, the keyword `clock` and the options of bench.toml, and gives what
`interfaces` asks of its kind. A twin is called with its machine (`simulated.machines`) and
those of the options that it takes; it has `address` and is a context manager that serves while it is entered. Where its
link may have faults it has `faults`, None at first, which `benchctl_instruments.simulated.tcp_server` plays.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util
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


def is_profile(model: str) -> bool:
    """Whether a chamber's model is the path of a profile."""
    return model.endswith(PROFILE)


def models(kind: Kind) -> tuple[str, ...]:
    """The models of a kind that have a driver, sorted: ours, and those that other packages add."""
    theirs = (name.partition(".")[2] for name in offers(DRIVERS) if name.startswith(f"{kind}."))
    return tuple(sorted({*our_models(kind), *theirs}))


def our_models(kind: Kind) -> tuple[str, ...]:
    """Those of ours, sorted."""
    package = importlib.import_module(f"benchctl_instruments.{_FOLDERS[kind]}")
    names = (module.name for module in pkgutil.iter_modules(package.__path__))
    return tuple(sorted(name for name in names if _member(name, package.__name__, "Driver") is not None))


def driver(kind: Kind, model: str, profile: str = "") -> Any:
    """What makes the driver; called with an address, the keyword `clock`, and the options of bench.toml.

    `profile` is the text of the profile that `model` names; without it that file is read.

    Raises
    ------
    UsageError
        Where no such model is known, its profile is not there or wrong, or the package that adds it cannot be used.
    """
    if is_profile(model):
        return _with_profile(kind, model, profile, "benchctl_instruments.chambers.profiled", "ProfiledChamber")
    ours = _member(model, f"benchctl_instruments.{_FOLDERS[kind]}", "Driver")
    found = _chosen(ours, offers(DRIVERS).get(f"{kind}.{model}"))
    if found is None:
        raise UsageError(f"{kind}.model: there is no {model!r}: {_known(kind, model)}")
    return found


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
        Where that model has no simulated twin, its profile is not there or wrong, or the package that adds it cannot be
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


def _member(model: str, package: str, name: str) -> Any:
    """What a module of ours, named after the model, has under that name; None where there is none."""
    if not model.isidentifier() or importlib.util.find_spec(f"{package}.{model}") is None:
        return None
    return getattr(importlib.import_module(f"{package}.{model}"), name, None)


def _chosen(ours: Any, offer: Offer | None) -> Any:
    """Ours, else what another package adds, else None."""
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
    """What the name of a model might have meant."""
    close = difflib.get_close_matches(model, models(kind), 1)
    return f"did you mean {close[0]}?" if close else f"there are {', '.join(models(kind))}"
