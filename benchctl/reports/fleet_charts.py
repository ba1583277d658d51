"""The charts of a fleet: how a figure is spread, which effects recur in which recordings, what the tests say.

Written as SVG at once, as those of a history are; a mark tells its numbers where the mouse rests.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

from markupsafe import Markup

from benchctl.reports import text
from benchctl.reports.figures import INK
from benchctl.reports.fleet_facts import VERDICTS, Member, Recurring, Spread, label
from benchctl.reports.fleet_stated import FoundEffect
from benchctl.reports.history_charts import amount
from benchctl.reports.svg_axis import padded, power, svg_of, text_at

_BLUE, _ORANGE = "#0072B2", "#D55E00"
_COLOURS = {"PASS": "#00705a", "FAIL": "#b3261e", "INCONCLUSIVE": "#c9a227"}
_WIDTH, _HEIGHT, _SIDE, _TOP, _BOTTOM = 280.0, 118.0, 12.0, 8.0, 28.0
_DOT = 5.6
"""A dot's width, and so that of the bins in which dots stand on each other."""
_FAR = 1.0
"""The limit of standing apart is drawn where it is not further away than so many times all values."""
_WIDE, _NAMES, _ROW = 850.0, 190.0, 24.0
_MOST_LABELS = 40


def spread_chart(spread: Spread) -> Markup:
    """The values of a figure, less their median: a dot each, stacked where they meet; ringed where they stand apart."""
    median = spread.median
    offsets = [figure.value - median for _, figure in spread.values]
    limit = spread.siblings.half_width if spread.siblings else 0.0
    edges = [-limit, limit] if 0.0 < limit <= max(map(abs, offsets)) * (1.0 + _FAR) else []
    across = padded([*offsets, *edges], _SIDE, _WIDTH - _SIDE)
    floor = _HEIGHT - _BOTTOM
    parts = [_upright(across.place(0.0), floor, _BLUE, "")]
    parts += [_upright(across.place(edge), floor, _BLUE, "4 3") for edge in edges]
    parts.append(Markup('<line x1="0" x2="{0}" y1="{1}" y2="{1}" stroke="#999"/>').format(_WIDTH, floor))
    for value, written in across.ticks():
        parts.append(text_at(across.place(value), floor + 11.0, written, "middle"))
    scale = power(across).removeprefix("× ") if across.exponent else ""
    unit = text.with_unit(scale, text.unit_text(spread.unit)).strip("\u00a0")
    said = f"less the median{f', in {unit}' if unit else ''}"
    parts.append(text_at(_WIDTH / 2, floor + 23.0, said, "middle"))
    apart = {member.recording for member, _, _ in spread.apart}
    stacks: dict[int, list[int]] = defaultdict(list)
    for number, offset in enumerate(offsets):
        stacks[int(across.place(offset) // _DOT)].append(number)
    rise = min(_DOT, (floor - _TOP - _DOT) / max(1, max(map(len, stacks.values())) - 1))
    for place, numbers in stacks.items():
        for height, number in enumerate(numbers):
            member, figure = spread.values[number]
            said = f"{label(member)}: {amount(figure.value, figure.uncertainty, spread.unit)}"
            x, y = (place + 0.5) * _DOT, floor - _DOT / 2 - height * rise
            parts.append(_dot(x, y, _DOT / 2 - 0.3, INK, said, ring=member.recording in apart))
    return svg_of(_WIDTH, _HEIGHT, 9.5, parts)


def effects_chart(found: Sequence[Recurring], of: Sequence[Member]) -> Markup:
    """Effects in rows, recordings in columns; a bar's height is the size beside the row's largest, its colour the sign.

    An effect without a size, such as a fault of the data, has a whole bar.
    """
    columns = {member.recording: number for number, member in enumerate(of)}
    wide = (_WIDE - _NAMES) / len(of)
    height = _ROW * len(found)
    parts = []
    for row, one in enumerate(found):
        floor = _ROW * (row + 1)
        parts.append(Markup('<line x1="{0}" x2="{1}" y1="{2}" y2="{2}" stroke="#bbb"/>').format(_NAMES, _WIDE, floor))
        parts.append(text_at(_NAMES - 10.0, floor - 6.0, f"{one.effect}  {one.count}/{len(of)}", "end"))
        largest = max((abs(size) for size in one.sizes), default=0.0)
        for member, effect in sorted(
            one.found, key=lambda each: -abs(_size(each[1], largest))
        ):  # the small ones on top
            size = _size(effect, largest)
            tall = max(2.0, (_ROW - 4.0) * (abs(size) / largest if largest else 1.0))
            x = _NAMES + columns[member.recording] * wide + 0.08 * wide
            said = f"{label(member)}: {one.effect}, {size_of(effect)}"
            parts.append(_bar(x, floor - tall, 0.84 * wide, tall, _ORANGE if size < 0.0 else _BLUE, said))
    if len(of) <= _MOST_LABELS:
        for number, member in enumerate(of):
            x = _NAMES + (number + 0.5) * wide
            parts.append(
                Markup('<text transform="translate({:.1f} {:.1f}) rotate(-60)" text-anchor="end">{}</text>').format(
                    x + 3.0, height + 10.0, _short(member.name)
                )
            )
        longest = max(len(_short(member.name)) for member in of)
        height += 14.0 + 5.2 * longest
    return svg_of(_WIDE, height, 10.5, parts)


def _size(effect: FoundEffect, otherwise: float) -> float:
    return effect.parameters[0].value if effect.parameters else otherwise


def size_of(effect: FoundEffect) -> str:
    """The parameters of a finding in words."""
    told = (
        f"{one.name} = {text.with_unit(text.number(one.value, 4), text.unit_text(one.unit))}"
        for one in effect.parameters
    )
    return ", ".join(told) or "found"


def tests_chart(tests: Mapping[str, Mapping[str, Sequence[Member]]]) -> Markup:
    """A bar for each test of the acceptances: how many pass, are inconclusive, fail."""
    parts = []
    for row, (name, by_verdict) in enumerate(tests.items()):
        y, x = _ROW * row, _NAMES
        parts.append(text_at(_NAMES - 10.0, y + _ROW / 2 + 3.5, _short(name.replace("_", " ")), "end"))
        total = sum(len(members) for members in by_verdict.values())
        for verdict in VERDICTS:
            count = len(by_verdict[verdict])
            width = (_WIDE - _NAMES) * count / total
            if count == 0:
                continue
            who = ", ".join(label(member) for member in by_verdict[verdict][:20])
            said = f"{name}: {count} {verdict}: {who}"
            parts.append(_bar(x, y + 3.0, width, _ROW - 6.0, _COLOURS[verdict], said))
            if width > 14.0:
                white = Markup('<text x="{:.1f}" y="{:.1f}" text-anchor="middle" fill="#fff">{}</text>')
                parts.append(white.format(x + width / 2, y + _ROW / 2 + 3.5, count))
            x += width
    return svg_of(_WIDE, _ROW * len(tests), 10.5, parts)


def _dot(x: float, y: float, radius: float, colour: str, title: str, *, ring: bool) -> Markup:
    around = Markup('<circle cx="{:.1f}" cy="{:.1f}" r="5.5" fill="none" stroke="{}" stroke-width="1.6"/>')
    dot = Markup('<g><title>{}</title><circle cx="{:.1f}" cy="{:.1f}" r="{:.1f}" fill="{}"/>{}</g>')
    return dot.format(title, x, y, radius, colour, around.format(x, y, _ORANGE) if ring else "")


def _bar(x: float, y: float, width: float, height: float, colour: str, title: str) -> Markup:
    return Markup(
        '<g><title>{}</title><rect x="{:.1f}" y="{:.1f}" width="{:.2f}" height="{:.1f}" fill="{}"/></g>'
    ).format(title, x, y, width, height, colour)


def _upright(x: float, floor: float, colour: str, dashes: str) -> Markup:
    return Markup('<line x1="{0:.1f}" x2="{0:.1f}" y1="2" y2="{1}" stroke="{2}" stroke-dasharray="{3}"/>').format(
        x, floor, colour, dashes
    )


def _short(name: str, longest: int = 26) -> str:
    return name if len(name) <= longest else f"{name[: longest - 1]}…"
