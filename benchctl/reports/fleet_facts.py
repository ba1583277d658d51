"""A fleet of recordings compared: how figures are spread over it, which physics recurs, what its acceptances say."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from benchctl.history.model import Figure
from benchctl.history.siblings import Siblings, siblings_of
from benchctl.reports.fleet_stated import FleetVerb, FoundEffect, Stated

VERDICTS = ("PASS", "FAIL", "INCONCLUSIVE")


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """A recording of the fleet: how the verb ended on it, and what is `stated` of it by verb, by earlier ones too.

    `recording` is its path or URL, as are `reports`, by verb; `says` is why it failed.
    """

    recording: str
    name: str
    serial: str
    model: str
    state: Literal["done", "kept", "failed"]
    says: str
    stated: Mapping[FleetVerb, Stated]
    reports: Mapping[FleetVerb, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleet:
    """A verb done over recordings; `left` are those that were not come to, as it was stopped."""

    verb: FleetVerb
    members: tuple[Member, ...]
    left: int

    def ended(self, state: str) -> list[Member]:
        """The members on which the verb ended so."""
        return [member for member in self.members if member.state == state]

    @property
    def rejected(self) -> list[Member]:
        """Of a fleet that was accepted, those that do not pass."""
        if self.verb != "accept":
            return []
        return [one for one in self.members if one.state != "failed" and one.stated["accept"].verdict != "PASS"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """One figure over the recordings of one model of gyro: `values` with the members that they are of.

    Values that are only bounds are left out. `siblings` judges who stands apart; None of too few, or of equal values.
    """

    verb: FleetVerb
    name: str
    unit: str
    model: str
    values: tuple[tuple[Member, Figure], ...]
    siblings: Siblings | None

    @property
    def median(self) -> float:
        """The median of the values."""
        return statistics.median(figure.value for _, figure in self.values)

    @property
    def apart(self) -> list[tuple[Member, Figure, float]]:
        """Who stands apart from the others, with the robust z, the furthest first."""
        if self.siblings is None:
            return []
        found = [
            (member, figure, self.siblings.z(figure.value))
            for member, figure in self.values
            if self.siblings.is_apart(figure.value, figure.uncertainty)
        ]
        return sorted(found, key=lambda one: -abs(one[2]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Recurring:
    """An effect, and the members in which a diagnosis found it; some, such as harmonics, several times in one."""

    effect: str
    found: tuple[tuple[Member, FoundEffect], ...]

    @property
    def count(self) -> int:
        """In how many members it was found."""
        return len({member.recording for member, _ in self.found})

    @property
    def sizes(self) -> list[float]:
        """The values of its first parameter, where there is one."""
        return [effect.parameters[0].value for _, effect in self.found if effect.parameters]


def spreads(fleet: Fleet) -> list[Spread]:
    """How each figure of fits and acceptances is spread, in the order in which they are stated."""
    found: dict[tuple[FleetVerb, str, str, str], list[tuple[Member, Figure]]] = defaultdict(list)
    for verb in ("fit", "accept"):
        for member in fleet.members:
            for figure in member.stated[verb].figures if verb in member.stated else ():
                if not figure.bound:
                    found[verb, figure.name, figure.unit, member.model].append((member, figure))
    return [
        Spread(
            verb=verb,
            name=name,
            unit=unit,
            model=model,
            values=tuple(values),
            siblings=siblings_of([figure.value for _, figure in values]),
        )
        for (verb, name, unit, model), values in found.items()
    ]


def diagnosed(fleet: Fleet) -> list[Member]:
    """The members of which there is a diagnosis."""
    return [member for member in fleet.members if "diagnose" in member.stated]


def recurring(fleet: Fleet) -> list[Recurring]:
    """The effects that diagnoses found, the most frequent first."""
    found: dict[str, list[tuple[Member, FoundEffect]]] = defaultdict(list)
    for member in diagnosed(fleet):
        for effect in member.stated["diagnose"].effects:
            found[effect.effect].append((member, effect))
    effects = [Recurring(effect=effect, found=tuple(members)) for effect, members in found.items()]
    return sorted(effects, key=lambda one: (-one.count, one.effect))


def judged(fleet: Fleet) -> dict[str, dict[str, list[Member]]]:
    """By the name of an acceptance's test and its verdict, who has it; tests with failures first."""
    found: dict[str, dict[str, list[Member]]] = {}
    for member in fleet.members:
        for name, verdict in member.stated["accept"].tests if "accept" in member.stated else ():
            found.setdefault(name, {each: [] for each in VERDICTS})[verdict].append(member)
    return dict(sorted(found.items(), key=lambda one: (-len(one[1]["FAIL"]), -len(one[1]["INCONCLUSIVE"]))))


def label(member: Member) -> str:
    """What a member is called: its recording's name, and its unit's serial where that says more."""
    return member.name if not member.serial or member.serial in member.name else f"{member.name} ({member.serial})"
