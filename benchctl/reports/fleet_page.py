"""The HTML page on a fleet: failures, the spread of figures, recurring effects, results of the acceptance tests.

The charts are written directly as SVG, like those of a history; a mark shows its numbers as a tooltip.
"""

from __future__ import annotations

import os
import statistics
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from markupsafe import Markup

from benchctl.history.flags import TO_DEVIATIONS
from benchctl.reports import text
from benchctl.reports.figures import INK, Drawing
from benchctl.reports.fleet_facts import (
    VERDICTS,
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
from benchctl.reports.fleet_stated import FleetVerb, FoundEffect
from benchctl.reports.history_charts import (
    amount,
    element,
    line,
    padded,
    power,
    ring,
    shortened,
    svg_of,
    text_at,
)
from benchctl.reports.html import render, write_page
from benchctl.reports.results import make_folder

REPORT = "fleet.html"
_TITLES: dict[FleetVerb, str] = {"fit": "Calibration", "accept": "Acceptance tests"}


def write_fleet_page(fleet: Fleet, folder: Path) -> Path:
    """Write `fleet.html` atomically and return its path. The page links to the reports of the recordings."""
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


def _groups(found: list[Spread]) -> list[tuple[str, list[dict[str, object]]]]:
    """Group figures by their source and the model of gyro; those with members that stand apart come first."""
    groups: dict[str, list[dict[str, object]]] = {}
    for spread in sorted(found, key=lambda one: not one.apart):
        title = f"{_TITLES[spread.verb]}{f', {spread.model}' if spread.model else ''}"
        groups.setdefault(title, []).append(_spread(spread))
    return sorted(groups.items(), key=lambda one: one[0].startswith(_TITLES["accept"]))


def _spread(spread: Spread) -> dict[str, object]:
    values = [figure.value for _, figure in spread.values]
    unit = text.unit_text(spread.unit)
    outliers = [
        f"{label(member)}: {amount(figure.value, figure.uncertainty, spread.unit)}, z = {text.number(z, 2)}"
        for member, figure, z in spread.apart
    ]
    deviation = spread.siblings.mad / TO_DEVIATIONS if spread.siblings else None
    median = text.with_unit(text.number(spread.median, 6), unit)
    return {
        "name": spread.name,
        "stated": f"median {median} of {len(values)}",
        "drawing": Drawing(
            svg=spread_chart(spread), alt=f"{spread.name} of {len(values)} recordings, median {median}", caption=""
        ),
        "apart": outliers,
        "median": median,
        "spread": text.number(deviation, 2),
        "low": text.number(min(values), 6),
        "high": text.number(max(values), 6),
        "count": len(values),
    }


def _effect(one: Recurring) -> dict[str, object]:
    sized = [(member, effect) for member, effect in one.found if effect.parameters]
    if not sized:
        nothing = dict.fromkeys(("parameter", "median", "low", "high", "largest"), text.NOT_KNOWN)
        return {"effect": one.effect, "count": one.count, **nothing}
    first = sized[0][1].parameters[0]
    member, effect = max(sized, key=lambda each: abs(each[1].parameters[0].value))
    return {
        "effect": one.effect,
        "count": one.count,
        "parameter": f"{first.name}{f' ({unit})' if (unit := text.unit_text(first.unit)) else ''}",
        "median": text.number(statistics.median(one.sizes), 4),
        "low": text.number(min(one.sizes), 4),
        "high": text.number(max(one.sizes), 4),
        "largest": f"{label(member)}: {size_of(effect)}",
    }


def _member(member: Member, folder: Path) -> dict[str, object]:
    diagnosis = member.stated.get("diagnose")
    return {
        "name": member.name,
        "serial": member.serial,
        "model": member.model,
        "state": member.state,
        "verdicts": [stated.verdict for stated in member.stated.values() if stated.verdict],
        "effects": ", ".join(dict.fromkeys(one.effect for one in diagnosis.effects)) if diagnosis else "",
        "reports": [(verb, _address(report, folder)) for verb, report in member.reports.items()],
    }


def _address(report: str, folder: Path) -> str:
    """Return a link to a report: a URL unchanged, a path relative to the page, so that both can be moved together."""
    if "://" in report:
        return report
    try:
        return quote(Path(os.path.relpath(report, folder)).as_posix())
    except ValueError:  # on another drive of Windows
        return Path(report).absolute().as_uri()


_BLUE, _ORANGE = "#0072B2", "#D55E00"
_COLOURS = {"PASS": "#00705a", "FAIL": "#b3261e", "INCONCLUSIVE": "#c9a227"}
_WIDTH, _HEIGHT, _SIDE, _TOP, _BOTTOM = 280.0, 118.0, 12.0, 8.0, 28.0
_DOT = 5.6
"""Diameter of a dot, and width of the bins in which dots are stacked."""
_FAR = 1.0
"""The limit for outliers is drawn if its distance is at most (1 + this) times the largest offset."""
_WIDE, _NAMES, _ROW = 850.0, 190.0, 24.0
_MOST_LABELS = 40


def spread_chart(spread: Spread) -> Markup:
    """Draw the values of a figure less their median: one dot each, stacked where they overlap, ringed for outliers."""
    median = spread.median
    offsets = [figure.value - median for _, figure in spread.values]
    limit = spread.siblings.half_width if spread.siblings else 0.0
    edges = [-limit, limit] if 0.0 < limit <= max(map(abs, offsets)) * (1.0 + _FAR) else []
    across = padded([*offsets, *edges], _SIDE, _WIDTH - _SIDE)
    floor = _HEIGHT - _BOTTOM
    parts = []
    for edge, dashes in ((0.0, ""), *((edge, "4 3") for edge in edges)):
        x = across.place(edge)
        parts.append(line(x, 2.0, x, floor, _BLUE, stroke_dasharray=dashes))
    parts.append(line(0.0, floor, _WIDTH, floor, "#999"))
    for value, written in across.ticks():
        parts.append(text_at(across.place(value), floor + 11.0, written, "middle"))
    scale = power(across).removeprefix("× ") if across.exponent else ""
    unit = text.with_unit(scale, text.unit_text(spread.unit)).strip("\u00a0")
    caption = f"less the median{f', in {unit}' if unit else ''}"
    parts.append(text_at(_WIDTH / 2, floor + 23.0, caption, "middle"))
    apart = {member.recording for member, _, _ in spread.apart}
    stacks: dict[int, list[int]] = defaultdict(list)
    for number, offset in enumerate(offsets):
        stacks[int(across.place(offset) // _DOT)].append(number)
    rise = min(_DOT, (floor - _TOP - _DOT) / max(1, max(map(len, stacks.values())) - 1))
    for place, numbers in stacks.items():
        for height, number in enumerate(numbers):
            member, figure = spread.values[number]
            caption = f"{label(member)}: {amount(figure.value, figure.uncertainty, spread.unit)}"
            x, y = (place + 0.5) * _DOT, floor - _DOT / 2 - height * rise
            dot = element("circle", cx=x, cy=y, r=_DOT / 2 - 0.3, fill=INK)
            parts.append(element("g", element("title", caption), dot, ring(x, y) if member.recording in apart else ""))
    return svg_of(_WIDTH, _HEIGHT, 9.5, parts)


def effects_chart(found: Sequence[Recurring], of: Sequence[Member]) -> Markup:
    """Draw effects in rows, recordings in columns; bar height is relative to the row's largest, colour is the sign.

    An effect without a size, such as a fault of the data, has a full bar.
    """
    columns = {member.recording: number for number, member in enumerate(of)}
    wide = (_WIDE - _NAMES) / len(of)
    height = _ROW * len(found)
    parts = []
    for row, one in enumerate(found):
        floor = _ROW * (row + 1)
        parts.append(line(_NAMES, floor, _WIDE, floor, "#bbb"))
        parts.append(text_at(_NAMES - 10.0, floor - 6.0, f"{one.effect}  {one.count}/{len(of)}", "end"))
        largest = max((abs(size) for size in one.sizes), default=0.0)
        for member, effect in sorted(
            one.found, key=lambda each: -abs(_size(each[1], largest))
        ):  # smaller bars are drawn last
            size = _size(effect, largest)
            tall = max(2.0, (_ROW - 4.0) * (abs(size) / largest if largest else 1.0))
            x = _NAMES + columns[member.recording] * wide + 0.08 * wide
            title = f"{label(member)}: {one.effect}, {size_of(effect)}"
            parts.append(_bar(x, floor - tall, 0.84 * wide, tall, _ORANGE if size < 0.0 else _BLUE, title))
    if len(of) <= _MOST_LABELS:
        for number, member in enumerate(of):
            x = _NAMES + (number + 0.5) * wide
            turned = f"translate({x + 3.0:.1f} {height + 10.0:.1f}) rotate(-60)"
            parts.append(element("text", shortened(member.name), transform=turned, text_anchor="end"))
        longest = max(len(shortened(member.name)) for member in of)
        height += 14.0 + 5.2 * longest
    return svg_of(_WIDE, height, 10.5, parts)


def _size(effect: FoundEffect, otherwise: float) -> float:
    return effect.parameters[0].value if effect.parameters else otherwise


def size_of(effect: FoundEffect) -> str:
    """Return the parameters of a finding as text."""
    parameters = (
        f"{one.name} = {text.with_unit(text.number(one.value, 4), text.unit_text(one.unit))}"
        for one in effect.parameters
    )
    return ", ".join(parameters) or "found"


def tests_chart(tests: Mapping[str, Mapping[str, Sequence[Member]]]) -> Markup:
    """Draw a bar for each test of the acceptances with the numbers that pass, are inconclusive or fail."""
    parts = []
    for row, (name, by_verdict) in enumerate(tests.items()):
        y, x = _ROW * row, _NAMES
        parts.append(text_at(_NAMES - 10.0, y + _ROW / 2 + 3.5, shortened(name.replace("_", " ")), "end"))
        total = sum(len(members) for members in by_verdict.values())
        for verdict in VERDICTS:
            count = len(by_verdict[verdict])
            width = (_WIDE - _NAMES) * count / total
            if count == 0:
                continue
            who = ", ".join(label(member) for member in by_verdict[verdict][:20])
            title = f"{name}: {count} {verdict}: {who}"
            parts.append(_bar(x, y + 3.0, width, _ROW - 6.0, _COLOURS[verdict], title))
            if width > 14.0:
                parts.append(text_at(x + width / 2, y + _ROW / 2 + 3.5, str(count), "middle", fill="#fff"))
            x += width
    return svg_of(_WIDE, _ROW * len(tests), 10.5, parts)


def _bar(x: float, y: float, width: float, height: float, colour: str, title: str) -> Markup:
    bar = element("rect", x=x, y=y, width=f"{width:.2f}", height=height, fill=colour)
    return element("g", element("title", title), bar)
