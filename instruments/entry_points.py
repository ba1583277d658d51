"""Entry points of other installed packages: found by name, loaded when needed, and rejected with a one-line message.

| group                  | name                           | object                                             |
|------------------------|--------------------------------|----------------------------------------------------|
| `benchctl.procedures`  | name of the procedure          | a function with `@procedure`                       |
| `benchctl.instruments` | `KIND.MODEL`, as in bench.toml | a driver, of a `catalog.Kind`                      |
| `benchctl.simulated`   | the same                       | its simulated twin, a server over its machine      |
| `benchctl.effects`     | the effect's identifier        | a class of effects, of any part of the bench       |

A built-in name is never replaced, and a name that two other packages add is ignored. Each ignored entry point is
reported once as a warning of this module's logger, which Python prints on stderr if logging is not configured.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from types import MappingProxyType
from typing import Any

from benchctl_instruments.errors import UsageError

OURS = "benchctl"

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Offer:
    """An entry point of an installed package."""

    point: EntryPoint

    @property
    def package(self) -> str:
        """The name of the package."""
        return "of unknown name" if self.point.dist is None else self.point.dist.name

    def load(self) -> Any:
        """Import and return the object.

        Raises
        ------
        UsageError
            If the import fails with any exception.
        """
        try:
            return self.point.load()
        except (Exception, SystemExit) as err:
            reason = " ".join(f"{type(err).__name__}: {err}".split())
            raise self.refused(f"cannot be loaded ({reason}); mend or uninstall that package") from err

    def refused(self, why: str) -> UsageError:
        """Return a `UsageError` stating that the object cannot be used."""
        offers = f"package {self.package} adds {self.point.group}, {self.point.name} = {self.point.value}"
        return UsageError(f"{offers}: {why}")


@lru_cache
def offers(group: str) -> Mapping[str, Offer]:
    """Return the entry points of all packages in a group, sorted by name."""
    named: dict[str, list[Offer]] = {}
    for point in entry_points(group=group):
        named.setdefault(point.name, []).append(Offer(point))
    taken = {name: _one_of(found) for name, found in sorted(named.items())}
    return MappingProxyType({name: offer for name, offer in taken.items() if offer is not None})


@lru_cache
def leave_out(offer: Offer, why: str) -> None:
    """Log once that an entry point is ignored."""
    logger.warning("benchctl: warning: %s", offer.refused(why))


def leave_out_clash(offer: Offer) -> None:
    """Log once that an entry point is ignored because a built-in one has its name."""
    leave_out(offer, "left out: benchctl has one of that name; its package must give it another")


def _one_of(found: list[Offer]) -> Offer | None:
    if len(found) == 1:  # the usual case; fast, since the package's metadata are not read
        return found[0]
    ours = [offer for offer in found if offer.package == OURS]
    if ours:
        for offer in found:
            if offer.package != OURS:
                leave_out_clash(offer)
        return ours[0]
    for offer in found:
        others = ", ".join(sorted({other.package for other in found if other is not offer}))
        leave_out(offer, f"left out: {others} adds one of that name too; uninstall one of them")
    return None
