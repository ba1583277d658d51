"""The charts of a history: a figure of a unit over time, and the latest value of each unit compared with the others.

The charts are written directly as SVG, because a folder of a thousand campaigns has thousands of them. All text from
files is escaped. A point shows its numbers as a tooltip.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime

from markupsafe import Markup

from benchctl.history.flags import Siblings
from benchctl.history.history import Charted
from benchctl.history.series import FigureSeries, Point
from benchctl.reports import text
from benchctl.reports.figures import GREY, INK

_ROOM = 0.08
_TICKS = 5


@dataclass(frozen=True, slots=True)
class Axis:
    """A linear map from values to positions; `exponent` is the power of ten omitted from its labels."""

    low: float
    high: float
    start: float
    end: float

    def place(self, value: float) -> float:
        """Return the position of a value."""
        return self.start + (self.end - self.start) * (value - self.low) / (self.high - self.low)

    @property
    def step(self) -> float:
        """The distance between two labels."""
        rough = (self.high - self.low) / _TICKS
        size = 10.0 ** math.floor(math.log10(rough))
        return next(size * factor for factor in (1.0, 2.0, 5.0, 10.0) if size * factor >= rough * (1 - 1e-9))

    @property
    def exponent(self) -> int:
        """The power of ten omitted from the labels."""
        largest = max(abs(self.low), abs(self.high))
        return 0 if 0.01 <= largest < 1e5 else 3 * math.floor(math.log10(largest) / 3)

    def ticks(self) -> list[tuple[float, str]]:
        """Return the values of the ticks and their labels."""
        step, unit = self.step, 10.0**self.exponent
        decimals = max(0, -math.floor(math.log10(step / unit) + 1e-9))
        counts = range(math.ceil(self.low / step), math.floor(self.high / step) + 1)
        return [(n * step, f"{n * step / unit:.{decimals}f}".replace("-", "−")) for n in counts]


def padded(values: Sequence[float], start: float, end: float) -> Axis:
    """Return an axis that shows all values with a margin; equal values get a small margin on both sides."""
    low, high = min(values), max(values)
    room, largest = _ROOM * (high - low), max(abs(low), abs(high))
    if largest == 0.0:
        room = 1.0
    elif room <= 1e-9 * largest:  # equal, or not distinguishable
        room = 0.05 * largest
    return Axis(low - room, high + room, start, end)


def power(axis: Axis) -> str:
    """Return the power of ten omitted from an axis' labels, as printed."""
    return text.raised(f"× 10^{axis.exponent}")


def text_at(x: float, y: float, words: str, anchor: str) -> Markup:
    """Return a text element; `anchor` is SVG's: start, middle or end."""
    return Markup('<text x="{:.1f}" y="{:.1f}" text-anchor="{}">{}</text>').format(x, y, anchor, words)


def svg_of(width: float, height: float, font_size: float, parts: Sequence[Markup]) -> Markup:
    """Return an SVG picture of these parts."""
    return Markup('<svg viewBox="0 0 {:.0f} {:.0f}" font-size="{}" fill="#444">{}</svg>').format(
        width, height, font_size, Markup("").join(parts)
    )


_CONTROL, _LIMIT, _FLAGGED = "#0072B2", "#B3261E", "#D55E00"
_WIDTH, _HEIGHT, _LEFT, _RIGHT, _TOP, _BOTTOM = 280.0, 138.0, 52.0, 8.0, 15.0, 18.0
_ROW, _WIDE, _NAMES = 19.0, 850.0, 170.0
_FAR = 2.0
"""Limits further away than this many spans of the data are stated, not drawn, unless a value exceeds them."""
_LONGEST_NAME, _LONGEST_LABEL = 24, 9
_DIGITS = 4


def time_chart(charted: Charted) -> Markup:
    """Draw a figure of a unit over time: points with expanded uncertainties, control limits, acceptance limits."""
    points = charted.series.points
    moments = [datetime.fromisoformat(point.started_utc).timestamp() for point in points]
    day = 43_200.0 if moments[0] == moments[-1] else 0.0
    across = Axis(moments[0] - day, moments[-1] + day, _LEFT + 6.0, _WIDTH - _RIGHT - 6.0)
    low, high = _span(points, [] if charted.control is None else [charted.control.low, charted.control.high])
    latest = charted.series.latest
    limits = [
        limit
        for limit, side in ((latest.low, -1.0), (latest.high, 1.0))
        if limit is not None
        and (
            low - _FAR * (high - low) <= limit <= high + _FAR * (high - low)
            or any(side * (point.value - limit) > 0.0 for point in points)
        )
    ]
    up = padded([low, high, *limits], _HEIGHT - _BOTTOM, _TOP)
    parts = [_scale(up), *_dates(points)]
    parts += [_line(up.place(limit), _LIMIT, 1.2, "") for limit in limits]
    if charted.control is not None:
        parts.append(_line(up.place(charted.control.centre), _CONTROL, 0.8, ""))
        parts += [_line(up.place(limit), _CONTROL, 0.8, "4 3") for limit in (charted.control.low, charted.control.high)]
    places = [(across.place(moment), up.place(point.value)) for moment, point in zip(moments, points, strict=True)]
    parts.append(_path(places))
    flagged = {flag.campaign for flag in charted.flags if flag.kind in ("outside_limits", "fails")}
    for point, (x, y) in zip(points, places, strict=True):
        error = None if point.uncertainty is None else abs(up.place(point.uncertainty) - up.place(0.0))
        title = Markup("<title>{}</title>").format(point_text(charted.series, point))
        parts.append(_mark(x, y, point, error, title, ring=point.campaign in flagged, upright=True))
    return svg_of(_WIDTH, _HEIGHT, 9.5, parts)


def units_chart(series: Sequence[FigureSeries], siblings: Siblings | None) -> Markup:
    """Draw the latest value of each unit, one per row; `siblings` gives the median and the limit for outliers."""
    points = [one.latest for one in series]
    band = [] if siblings is None else [siblings.median - siblings.half_width, siblings.median + siblings.half_width]
    low, high = _span(points, [])
    near = [edge for edge in band if low - _FAR * (high - low) <= edge <= high + _FAR * (high - low)]
    across = padded([low, high, *near], _NAMES, _WIDE - 14.0)
    height = _ROW * len(points) + 2.0
    parts = [
        Markup(
            '<line x1="{0:.1f}" x2="{0:.1f}" y1="0" y2="{1:.1f}" stroke="#e6e6e6"/>'
            '<text x="{0:.1f}" y="{2:.1f}" text-anchor="middle">{3}</text>'
        ).format(across.place(value), height, height + 11.0, label)
        for value, label in across.ticks()
    ]
    if across.exponent:
        parts.append(text_at(_WIDE, height + 22.0, power(across), "end"))
    if siblings is not None:
        for edge, dashes in ((siblings.median, ""), *((edge, "4 3") for edge in near)):
            parts.append(
                Markup(
                    '<line x1="{0:.1f}" x2="{0:.1f}" y1="0" y2="{1:.1f}" stroke="{2}" stroke-dasharray="{3}"/>'
                ).format(across.place(edge), height, _CONTROL, dashes)
            )
    for row, (one, point) in enumerate(zip(series, points, strict=True)):
        y = _ROW * (row + 0.5) + 1.0
        parts.append(text_at(_NAMES - 10.0, y + 3.0, shortened(one.serial, _LONGEST_NAME), "end"))
        error = None if point.uncertainty is None else across.place(point.uncertainty) - across.place(0.0)
        apart = siblings is not None and not point.bound and siblings.is_apart(point.value, point.uncertainty)
        title = Markup("<title>{}: {}</title>").format(one.serial, point_text(one, point))
        parts.append(_mark(across.place(point.value), y, point, error, title, ring=apart, upright=False))
    return svg_of(_WIDE, height + (26.0 if across.exponent else 15.0), 11.0, parts)


def point_text(series: FigureSeries, point: Point) -> str:
    """Return a point as text: value, uncertainty, date, campaign, verdict."""
    parts = [point.started_utc[:16].replace("T", " "), stated(series, point), point.verdict, point.campaign]
    return " · ".join(part for part in parts if part)


def stated(series: FigureSeries, point: Point) -> str:
    """Return a point's value, its expanded uncertainty and its unit."""
    value = amount(point.value, point.uncertainty, series.unit)
    return f"{point.bound} {value}" if point.bound else value


def amount(value: float, uncertainty: float | None, unit: str) -> str:
    """Return a value rounded by its uncertainty, or to four digits if that is not known."""
    if uncertainty is None:
        return text.with_unit(text.number(value, _DIGITS), text.unit_text(unit))
    return text.with_uncertainty(value, uncertainty, text.unit_text(unit))


def _span(points: Sequence[Point], more: Sequence[float]) -> tuple[float, float]:
    """Return the lowest and highest of the values with their uncertainties and of `more`."""
    ends = [point.value + side * (point.uncertainty or 0.0) for point in points for side in (-1.0, 1.0)]
    return min([*ends, *more]), max([*ends, *more])


def _scale(up: Axis) -> Markup:
    lines = [
        Markup(
            '<line x1="{1}" x2="{2}" y1="{0:.1f}" y2="{0:.1f}" stroke="#e6e6e6"/>'
            '<text x="{3}" y="{4:.1f}" text-anchor="end"{6}>{5}</text>'
        ).format(up.place(value), _LEFT, _WIDTH - _RIGHT, _LEFT - 4.0, up.place(value) + 3.0, label, _narrow(label))
        for value, label in up.ticks()
    ]
    return Markup("").join([*lines, text_at(2.0, 8.0, power(up), "start") if up.exponent else Markup("")])


def _narrow(label: str) -> Markup:
    """Return the attribute that compresses long labels, so that their first digits are not cut off."""
    long = len(label) > _LONGEST_LABEL
    return Markup(' textLength="{}" lengthAdjust="spacingAndGlyphs"').format(_LEFT - 6.0) if long else Markup("")


def _dates(points: Sequence[Point]) -> list[Markup]:
    """Return the dates of the first and of the last point, at the ends of the axis."""
    first, last = points[0].started_utc[:10], points[-1].started_utc[:10]
    y = _HEIGHT - 4.0
    if first == last:
        return [text_at((_LEFT + _WIDTH - _RIGHT) / 2, y, first, "middle")]
    return [text_at(_LEFT, y, first, "start"), text_at(_WIDTH - _RIGHT, y, last, "end")]


def _mark(x: float, y: float, point: Point, error: float | None, title: Markup, *, ring: bool, upright: bool) -> Markup:
    """Draw a point with its error bar: a cross if it fails, hollow if it is only a bound, ringed if flagged."""
    parts = [title]
    if error is not None and not point.bound:
        dx, dy = (0.0, error) if upright else (error, 0.0)
        parts.append(
            Markup('<line x1="{:.1f}" x2="{:.1f}" y1="{:.1f}" y2="{:.1f}" stroke="{}" stroke-width="0.9"/>').format(
                x - dx, x + dx, y - dy, y + dy, GREY
            )
        )
    if ring:
        parts.append(
            Markup('<circle cx="{:.1f}" cy="{:.1f}" r="5.5" fill="none" stroke="{}" stroke-width="1.6"/>').format(
                x, y, _FLAGGED
            )
        )
    if point.verdict == "FAIL":
        parts.append(
            Markup('<path d="M{0:.1f} {1:.1f}l6 6m0 -6l-6 6" stroke="{2}" stroke-width="1.8"/>').format(
                x - 3.0, y - 3.0, _LIMIT
            )
        )
    else:
        fill = "#fff" if point.bound else INK
        parts.append(Markup('<circle cx="{:.1f}" cy="{:.1f}" r="2.6" fill="{}" stroke="{}"/>').format(x, y, fill, INK))
    parts.append(Markup('<circle cx="{:.1f}" cy="{:.1f}" r="8" fill="transparent"/>').format(x, y))
    return Markup("<g>{}</g>").format(Markup("").join(parts))


def _path(places: Iterable[tuple[float, float]]) -> Markup:
    corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    return Markup('<polyline points="{}" fill="none" stroke="{}" stroke-width="0.7"/>').format(corners, GREY)


def _line(y: float, colour: str, width: float, dashes: str) -> Markup:
    return Markup(
        '<line x1="{}" x2="{}" y1="{:.1f}" y2="{:.1f}" stroke="{}" stroke-width="{}" stroke-dasharray="{}"/>'
    ).format(_LEFT, _WIDTH - _RIGHT, y, y, colour, width, dashes)


def shortened(name: str, longest: int = 26) -> str:
    """Cut a name off, with an ellipsis."""
    return name if len(name) <= longest else f"{name[: longest - 1]}…"
