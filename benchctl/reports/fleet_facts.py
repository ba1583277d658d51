"""Statistics of a fleet: recurring effects, the spread of figures and test verdicts; as lines and as JSON values."""

from __future__ import annotations

import json
import statistics
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from benchctl.atomic import whole_file
from benchctl.history.flags import Siblings, siblings_of
from benchctl.history.series import Figure
from benchctl.reports import text
from benchctl.reports.fleet_stated import FleetVerb, FoundEffect, Stated

VERDICTS = ("PASS", "FAIL", "INCONCLUSIVE")


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """A recording of the fleet: the outcome of the verb, and the `stated` results by verb, including earlier verbs.

    `recording` is its path or URL, as are `reports`, by verb; `reason` is that of a failure.
    """

    recording: str
    name: str
    serial: str
    model: str
    state: Literal["done", "kept", "failed"]
    reason: str
    stated: Mapping[FleetVerb, Stated]
    reports: Mapping[FleetVerb, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleet:
    """A verb applied to recordings; `left` counts those not processed because the run was stopped."""

    verb: FleetVerb
    members: tuple[Member, ...]
    left: int

    def ended(self, state: str) -> list[Member]:
        """Return the members with this state."""
        return [member for member in self.members if member.state == state]

    @property
    def rejected(self) -> list[Member]:
        """The members of an accepted fleet that do not pass."""
        if self.verb != "accept":
            return []
        return [one for one in self.members if one.state != "failed" and one.stated["accept"].verdict != "PASS"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """One figure over the recordings of one model of gyro: `values` with their members.

    Values that are only bounds are left out. `siblings` detects outliers; None for too few or equal values.
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
        """The members that stand apart from the others, with the robust z, the largest first."""
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
    """An effect, and the members in which a diagnosis found it; some, such as harmonics, occur several times in one."""

    effect: str
    found: tuple[tuple[Member, FoundEffect], ...]

    @property
    def count(self) -> int:
        """The number of members in which it was found."""
        return len({member.recording for member, _ in self.found})

    @property
    def sizes(self) -> list[float]:
        """The values of its first parameter, if it has one."""
        return [effect.parameters[0].value for _, effect in self.found if effect.parameters]


def spreads(fleet: Fleet) -> list[Spread]:
    """Return the spread of each figure of fits and acceptances, in the order in which they are stated."""
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
    """Return the members that have a diagnosis."""
    return [member for member in fleet.members if "diagnose" in member.stated]


def recurring(fleet: Fleet) -> list[Recurring]:
    """Return the effects that diagnoses found, the most frequent first."""
    found: dict[str, list[tuple[Member, FoundEffect]]] = defaultdict(list)
    for member in diagnosed(fleet):
        for effect in member.stated["diagnose"].effects:
            found[effect.effect].append((member, effect))
    effects = [Recurring(effect=effect, found=tuple(members)) for effect, members in found.items()]
    return sorted(effects, key=lambda one: (-one.count, one.effect))


def judged(fleet: Fleet) -> dict[str, dict[str, list[Member]]]:
    """Return the members by test name and verdict; tests with failures first."""
    found: dict[str, dict[str, list[Member]]] = {}
    for member in fleet.members:
        for name, verdict in member.stated["accept"].tests if "accept" in member.stated else ():
            found.setdefault(name, {each: [] for each in VERDICTS})[verdict].append(member)
    return dict(sorted(found.items(), key=lambda one: (-len(one[1]["FAIL"]), -len(one[1]["INCONCLUSIVE"]))))


def label(member: Member) -> str:
    """Return the label of a member: its recording's name, with its unit's serial if the name does not contain it."""
    return member.name if not member.serial or member.serial in member.name else f"{member.name} ({member.serial})"


SCHEMA = "benchctl-fleet/1"


def fleet_values(fleet: Fleet) -> dict[str, Any]:
    """Return the fleet as plain data; recordings are named by their paths or URLs."""
    return {
        "verb": fleet.verb,
        "recordings": {
            "total": len(fleet.members) + fleet.left,
            **{state: len(fleet.ended(state)) for state in ("done", "kept", "failed")},
            "left": fleet.left,
        },
        "members": [_member(member) for member in fleet.members],
        "failures": [{"recording": one.recording, "says": one.reason} for one in fleet.ended("failed")],
        "figures": [_spread(spread) for spread in spreads(fleet)],
        "effects": [_recurring(one, len(diagnosed(fleet))) for one in recurring(fleet)],
        "tests": [
            {"name": name, **{verdict: [one.recording for one in members] for verdict, members in by_verdict.items()}}
            for name, by_verdict in judged(fleet).items()
        ],
    }


def write_fleet_file(path: Path, fleet: Fleet) -> None:
    """Write the file atomically; raises `UsageError` if it cannot be written."""
    with whole_file(path) as temporary:
        content = {"schema": SCHEMA, **fleet_values(fleet)}
        text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
        temporary.write_text(f"{text}\n", encoding="utf-8")


def _member(member: Member) -> dict[str, Any]:
    return {
        "recording": member.recording,
        "unit": member.serial,
        "model": member.model,
        "state": member.state,
        "says": member.reason,
        "verdicts": {verb: stated.verdict for verb, stated in member.stated.items() if stated.verdict},
        "reports": dict(member.reports),
    }


def _spread(spread: Spread) -> dict[str, Any]:
    values, siblings = [figure.value for _, figure in spread.values], spread.siblings
    return {
        "name": spread.name,
        "unit": spread.unit,
        "model": spread.model,
        "from": spread.verb,
        "median": spread.median,
        "low": min(values),
        "high": max(values),
        "mad": siblings.mad if siblings else None,
        "limit": siblings.limit if siblings else None,
        "apart": [{"recording": one.recording, "value": figure.value, "z": z} for one, figure, z in spread.apart],
        "values": [
            {"recording": one.recording, "value": figure.value, "uncertainty": figure.uncertainty}
            for one, figure in spread.values
        ],
    }


def _recurring(one: Recurring, of: int) -> dict[str, Any]:
    first = next((effect.parameters[0] for _, effect in one.found if effect.parameters), None)
    return {
        "effect": one.effect,
        "found": one.count,
        "of": of,
        "parameter": first.name if first else None,
        "unit": first.unit if first else None,
        "median": statistics.median(one.sizes) if one.sizes else None,
        "low": min(one.sizes, default=None),
        "high": max(one.sizes, default=None),
        "recordings": [
            {
                "recording": member.recording,
                "explains": effect.explains,
                "parameters": [asdict(parameter) for parameter in effect.parameters],
            }
            for member, effect in one.found
        ],
    }


_MOST = 20
"""Number of failures, and of figures apart, in the lines; the report has all."""


def lines(fleet: Fleet) -> Iterator[str]:
    """Yield the counts, the failures, the figures apart, the recurring effects and the tests that do not pass."""
    counts = {state: len(fleet.ended(state)) for state in ("done", "kept", "failed")}
    states = [
        f"{counts['done']} done",
        f"{counts['kept']} unchanged since they were done",
        f"{counts['failed']} failed",
    ]
    left = [f"{fleet.left} left"] if fleet.left else []
    total = len(fleet.members) + fleet.left
    yield f"{fleet.verb} of {total} {'recording' if total == 1 else 'recordings'}: {', '.join([*states, *left])}"
    yield from _first([f"failed: {member.reason}" for member in fleet.ended("failed")])
    yield from _first(
        [
            f"apart: {spread.name} of {label(member)}: {text.with_unit(text.number(figure.value, 5), spread.unit)}, "
            f"median {text.number(spread.median, 5)}, robust z = {text.number(z, 2)}"
            for spread in spreads(fleet)
            for member, figure, z in spread.apart
        ]
    )
    if of := diagnosed(fleet):
        verdicts = Counter(member.stated["diagnose"].verdict for member in of)
        yield f"diagnoses: {', '.join(f'{count} {verdict}' for verdict, count in verdicts.most_common())}"
        yield from _first([f"  {one.effect} in {one.count} of {len(of)}" for one in recurring(fleet)])
    accepted = [member.stated["accept"].verdict for member in fleet.members if "accept" in member.stated]
    if accepted:
        yield f"acceptances: {', '.join(f'{count} {verdict}' for verdict, count in Counter(accepted).most_common())}"
    yield from _first(
        [
            f"  {name}: {len(by['FAIL'])} FAIL, {len(by['INCONCLUSIVE'])} INCONCLUSIVE, {len(by['PASS'])} PASS"
            for name, by in judged(fleet).items()
            if by["FAIL"] or by["INCONCLUSIVE"]
        ]
    )


def _first(lines: list[str]) -> Iterator[str]:
    yield from lines[:_MOST]
    if len(lines) > _MOST:
        yield f"and {len(lines) - _MOST} more such; the report has all"
