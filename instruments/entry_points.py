"""What other installed packages add by entry points: found by name, loaded when asked for, refused in one line.

| group                  | a name                         | what it names                                      |
|------------------------|--------------------------------|----------------------------------------------------|
| `benchctl.procedures`  | that of the procedure          | a function with `@procedure`                       |
| `benchctl.instruments` | `KIND.MODEL`, as in bench.toml | a driver, of a `catalog.Kind`                      |
| `benchctl.simulated`   | the same                       | its simulated twin, a server over its machine      |
| `benchctl.effects`     | the effect's identifier        | a class of effects, of whatever part of the bench  |

A name of ours is never replaced, and of a name that two other packages add neither is taken. What is left out is said
once, as a warning of this module's logger, which Python shows on stderr where nobody has set logging up.
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
    """Something that an installed package adds."""

    point: EntryPoint

    @property
    def package(self) -> str:
        """The name of the package."""
        return "of unknown name" if self.point.dist is None else self.point.dist.name

    def load(self) -> Any:
        """What it names.

        Raises
        ------
        UsageError
            Where importing it fails, whatever the package's modules raise.
        """
        try:
            return self.point.load()
        except (Exception, SystemExit) as err:
            reason = " ".join(f"{type(err).__name__}: {err}".split())
            raise self.refused(f"cannot be loaded ({reason}); mend or uninstall that package") from err

    def refused(self, why: str) -> UsageError:
        """That it cannot be used."""
        offers = f"package {self.package} adds {self.point.group}, {self.point.name} = {self.point.value}"
        return UsageError(f"{offers}: {why}")


@lru_cache
def offers(group: str) -> Mapping[str, Offer]:
    """What all packages add to a group, by name, sorted."""
    named: dict[str, list[Offer]] = {}
    for point in entry_points(group=group):
        named.setdefault(point.name, []).append(Offer(point))
    taken = {name: _one_of(found) for name, found in sorted(named.items())}
    return MappingProxyType({name: offer for name, offer in taken.items() if offer is not None})


@lru_cache
def leave_out(offer: Offer, why: str) -> None:
    """Say, once, that an offer is not taken."""
    logger.warning("benchctl: warning: %s", offer.refused(why))


def leave_out_clash(offer: Offer) -> None:
    """Say, once, that an offer is not taken because ours has the name."""
    leave_out(offer, "left out: benchctl has one of that name; its package must give it another")


def _one_of(found: list[Offer]) -> Offer | None:
    if len(found) == 1:  # as usual; it is quick, for it does not read what the package says of itself
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
