"""The charts of a history: a figure of a unit over time, and the latest value of each unit compared with the others.

The charts are written directly as SVG, because a folder of a thousand campaigns has thousands of them. All text from
files is escaped. A point shows its numbers as a tooltip.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
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


def element(tag: str, *contents: str, **attributes: object) -> Markup:
    """Return an SVG element; `stroke_width` is stroke-width, numbers have one decimal, empty texts are left out."""
    written = [
        Markup(' {}="{}"').format(name.replace("_", "-"), f"{value:.1f}" if isinstance(value, float) else value)
        for name, value in attributes.items()
        if value != ""
    ]
    return Markup("<{0}{1}>{2}</{0}>").format(tag, Markup("").join(written), Markup("").join(contents))


def text_at(x: float, y: float, words: str, anchor: str, **more: object) -> Markup:
    """Return a text element; `anchor` is SVG's: start, middle or end."""
    return element("text", words, x=x, y=y, text_anchor=anchor, **more)


def line(x1: float, y1: float, x2: float, y2: float, colour: str, **more: object) -> Markup:
    """Return a straight line."""
    return element("line", x1=x1, x2=x2, y1=y1, y2=y2, stroke=colour, **more)


def ring(x: float, y: float) -> Markup:
    """Return the ring around a conspicuous point."""
    return element("circle", cx=x, cy=y, r=5.5, fill="none", stroke=_FLAGGED, stroke_width=1.6)


def svg_of(width: float, height: float, font_size: float, parts: Sequence[Markup]) -> Markup:
    """Return an SVG picture of these parts."""
    return element("svg", *parts, viewBox=f"0 0 {width:.0f} {height:.0f}", font_size=font_size, fill="#444")


_CONTROL, _LIMIT, _FLAGGED, _FAINT = "#0072B2", "#B3261E", "#D55E00", "#e6e6e6"
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
    parts = [*_scale(up), *_dates(points)]
    parts += [_level(up.place(limit), _LIMIT, 1.2) for limit in limits]
    if charted.control is not None:
        parts.append(_level(up.place(charted.control.centre), _CONTROL, 0.8))
        parts += [
            _level(up.place(limit), _CONTROL, 0.8, "4 3") for limit in (charted.control.low, charted.control.high)
        ]
    places = [(across.place(moment), up.place(point.value)) for moment, point in zip(moments, points, strict=True)]
    corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    parts.append(element("polyline", points=corners, fill="none", stroke=GREY, stroke_width=0.7))
    flagged = {flag.campaign for flag in charted.flags if flag.kind in ("outside_limits", "fails")}
    for point, (x, y) in zip(points, places, strict=True):
        error = None if point.uncertainty is None else abs(up.place(point.uncertainty) - up.place(0.0))
        title = point_text(charted.series, point)
        parts.append(_mark(x, y, point, error, title, ringed=point.campaign in flagged, upright=True))
    return svg_of(_WIDTH, _HEIGHT, 9.5, parts)


def units_chart(series: Sequence[FigureSeries], siblings: Siblings | None) -> Markup:
    """Draw the latest value of each unit, one per row; `siblings` gives the median and the limit for outliers."""
    points = [one.latest for one in series]
    band = [] if siblings is None else [siblings.median - siblings.half_width, siblings.median + siblings.half_width]
    low, high = _span(points, [])
    near = [edge for edge in band if low - _FAR * (high - low) <= edge <= high + _FAR * (high - low)]
    across = padded([low, high, *near], _NAMES, _WIDE - 14.0)
    height = _ROW * len(points) + 2.0
    parts = []
    for value, label in across.ticks():
        x = across.place(value)
        parts += [line(x, 0.0, x, height, _FAINT), text_at(x, height + 11.0, label, "middle")]
    if across.exponent:
        parts.append(text_at(_WIDE, height + 22.0, power(across), "end"))
    if siblings is not None:
        for edge, dashes in ((siblings.median, ""), *((edge, "4 3") for edge in near)):
            x = across.place(edge)
            parts.append(line(x, 0.0, x, height, _CONTROL, stroke_dasharray=dashes))
    for row, (one, point) in enumerate(zip(series, points, strict=True)):
        y = _ROW * (row + 0.5) + 1.0
        parts.append(text_at(_NAMES - 10.0, y + 3.0, shortened(one.serial, _LONGEST_NAME), "end"))
        error = None if point.uncertainty is None else across.place(point.uncertainty) - across.place(0.0)
        apart = siblings is not None and not point.bound and siblings.is_apart(point.value, point.uncertainty)
        title = f"{one.serial}: {point_text(one, point)}"
        parts.append(_mark(across.place(point.value), y, point, error, title, ringed=apart, upright=False))
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


def _scale(up: Axis) -> Iterator[Markup]:
    """Yield the levels of the vertical axis; long labels are compressed, so that their first digits are not cut off."""
    for value, label in up.ticks():
        narrow = {"textLength": _LEFT - 6.0, "lengthAdjust": "spacingAndGlyphs"} if len(label) > _LONGEST_LABEL else {}
        yield _level(up.place(value), _FAINT)
        yield text_at(_LEFT - 4.0, up.place(value) + 3.0, label, "end", **narrow)
    if up.exponent:
        yield text_at(2.0, 8.0, power(up), "start")


def _dates(points: Sequence[Point]) -> list[Markup]:
    """Return the dates of the first and of the last point, at the ends of the axis."""
    first, last = points[0].started_utc[:10], points[-1].started_utc[:10]
    y = _HEIGHT - 4.0
    if first == last:
        return [text_at((_LEFT + _WIDTH - _RIGHT) / 2, y, first, "middle")]
    return [text_at(_LEFT, y, first, "start"), text_at(_WIDTH - _RIGHT, y, last, "end")]


def _mark(x: float, y: float, point: Point, error: float | None, title: str, *, ringed: bool, upright: bool) -> Markup:
    """Draw a point with its error bar: a cross if it fails, hollow if it is only a bound, ringed if flagged."""
    parts = [element("title", title)]
    if error is not None and not point.bound:
        dx, dy = (0.0, error) if upright else (error, 0.0)
        parts.append(line(x - dx, y - dy, x + dx, y + dy, GREY, stroke_width=0.9))
    if ringed:
        parts.append(ring(x, y))
    if point.verdict == "FAIL":
        cross = f"M{x - 3.0:.1f} {y - 3.0:.1f}l6 6m0 -6l-6 6"
        parts.append(element("path", d=cross, stroke=_LIMIT, stroke_width=1.8))
    else:
        parts.append(element("circle", cx=x, cy=y, r=2.6, fill="#fff" if point.bound else INK, stroke=INK))
    parts.append(element("circle", cx=x, cy=y, r=8, fill="transparent"))
    return element("g", *parts)


def _level(y: float, colour: str, width: float | str = "", dashes: str = "") -> Markup:
    return line(_LEFT, y, _WIDTH - _RIGHT, y, colour, stroke_width=width, stroke_dasharray=dashes)


def shortened(name: str, longest: int = 26) -> str:
    """Cut a name off, with an ellipsis."""
    return name if len(name) <= longest else f"{name[: longest - 1]}…"
