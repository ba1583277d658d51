"""The page on a fleet: what failed, how figures are spread, which physics recurs, what the acceptances say."""

from __future__ import annotations

import os
import statistics
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from benchctl.reports import text
from benchctl.reports.figures import Drawing
from benchctl.reports.fleet_charts import effects_chart, size_of, spread_chart, tests_chart
from benchctl.reports.fleet_facts import (
    Fleet,
    Member,
    Recurring,
    Spread,
    diagnosed,
    judged,
    label,
    recurring,
    spreads,
)
from benchctl.reports.fleet_stated import FleetVerb
from benchctl.reports.history_charts import amount
from benchctl.reports.html import render, write_page
from benchctl.reports.results import make_folder

REPORT = "fleet.html"
_TITLES: dict[FleetVerb, str] = {"fit": "Calibration", "accept": "Acceptance tests"}


@dataclass(frozen=True, slots=True, kw_only=True)
class SpreadRow:
    """A figure as the page shows it."""

    name: str
    stated: str
    drawing: Drawing
    apart: list[str]
    median: str
    spread: str
    low: str
    high: str
    count: int


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectRow:
    """An effect as the page shows it: in how many, its first parameter, and where it is largest."""

    effect: str
    count: int
    parameter: str
    median: str
    low: str
    high: str
    largest: str


@dataclass(frozen=True, slots=True, kw_only=True)
class MemberRow:
    """A recording as the page shows it; `reports` are the words and addresses of links."""

    name: str
    serial: str
    model: str
    state: str
    verdicts: list[str]
    effects: str
    reports: list[tuple[str, str]]


def write_fleet_page(fleet: Fleet, folder: Path) -> Path:
    """Write `fleet.html`, whole or not at all; its path. Links lead from there to the single reports."""
    make_folder(folder)
    found, of, tests = recurring(fleet), diagnosed(fleet), judged(fleet)
    page = render(
        "fleet.html.j2",
        fleet=fleet,
        counts={state: len(fleet.ended(state)) for state in ("done", "kept", "failed")},
        total=len(fleet.members) + fleet.left,
        groups=_groups(spreads(fleet)),
        effects=[_effect(one) for one in found],
        effects_map=Drawing(
            svg=effects_chart(found, of), alt=f"{len(found)} effects in {len(of)} recordings", caption=""
        )
        if found
        else None,
        diagnoses=Counter(member.stated["diagnose"].verdict for member in of).most_common(),
        tests=[(name, by_verdict) for name, by_verdict in tests.items()],
        tests_map=Drawing(svg=tests_chart(tests), alt=f"verdicts of {len(tests)} tests", caption="") if tests else None,
        verdicts=Counter(
            member.stated["accept"].verdict for member in fleet.members if "accept" in member.stated
        ).most_common(),
        members=[_member(member, folder) for member in fleet.members],
        label=label,
    )
    write_page(folder / REPORT, page)
    return folder / REPORT


def _groups(found: list[Spread]) -> list[tuple[str, list[SpreadRow]]]:
    """Figures by where they come from and the model of gyro; those in which somebody stands apart first."""
    groups: dict[str, list[SpreadRow]] = {}
    for spread in sorted(found, key=lambda one: not one.apart):
        title = f"{_TITLES[spread.verb]}{f', {spread.model}' if spread.model else ''}"
        groups.setdefault(title, []).append(_spread(spread))
    return sorted(groups.items(), key=lambda one: one[0].startswith(_TITLES["accept"]))


def _spread(spread: Spread) -> SpreadRow:
    values = [figure.value for _, figure in spread.values]
    unit = text.unit_text(spread.unit)
    said = [
        f"{label(member)}: {amount(figure.value, figure.uncertainty, spread.unit)}, z = {text.number(z, 2)}"
        for member, figure, z in spread.apart
    ]
    deviation = spread.siblings.mad / 0.6745 if spread.siblings else None
    median = text.with_unit(text.number(spread.median, 6), unit)
    return SpreadRow(
        name=spread.name,
        stated=f"median {median} of {len(values)}",
        drawing=Drawing(
            svg=spread_chart(spread), alt=f"{spread.name} of {len(values)} recordings, median {median}", caption=""
        ),
        apart=said,
        median=median,
        spread=text.number(deviation, 2),
        low=text.number(min(values), 6),
        high=text.number(max(values), 6),
        count=len(values),
    )


def _effect(one: Recurring) -> EffectRow:
    sized = [(member, effect) for member, effect in one.found if effect.parameters]
    if not sized:
        nothing = dict.fromkeys(("parameter", "median", "low", "high", "largest"), text.NOT_KNOWN)
        return EffectRow(effect=one.effect, count=one.count, **nothing)
    first = sized[0][1].parameters[0]
    member, effect = max(sized, key=lambda each: abs(each[1].parameters[0].value))
    return EffectRow(
        effect=one.effect,
        count=one.count,
        parameter=f"{first.name}{f' ({unit})' if (unit := text.unit_text(first.unit)) else ''}",
        median=text.number(statistics.median(one.sizes), 4),
        low=text.number(min(one.sizes), 4),
        high=text.number(max(one.sizes), 4),
        largest=f"{label(member)}: {size_of(effect)}",
    )


def _member(member: Member, folder: Path) -> MemberRow:
    diagnosis = member.stated.get("diagnose")
    return MemberRow(
        name=member.name,
        serial=member.serial,
        model=member.model,
        state=member.state,
        verdicts=[stated.verdict for stated in member.stated.values() if stated.verdict],
        effects=", ".join(dict.fromkeys(one.effect for one in diagnosis.effects)) if diagnosis else "",
        reports=[(verb, _address(report, folder)) for verb, report in member.reports.items()],
    )


def _address(report: str, folder: Path) -> str:
    """A link to a report: a URL as it is, a path from the page's folder, so that both may be moved together."""
    if "://" in report:
        return report
    try:
        return quote(Path(os.path.relpath(report, folder)).as_posix())
    except ValueError:  # on another drive of Windows
        return Path(report).absolute().as_uri()
