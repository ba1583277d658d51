"""Small charts that are written as SVG at once: their axes and words. Whatever comes from a file is escaped."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from benchctl.reports import text

_ROOM = 0.08
_TICKS = 5


@dataclass(frozen=True, slots=True)
class Axis:
    """From values to places on a line; `exponent` is the power of ten that its labels leave out."""

    low: float
    high: float
    start: float
    end: float

    def place(self, value: float) -> float:
        """Where a value lies."""
        return self.start + (self.end - self.start) * (value - self.low) / (self.high - self.low)

    @property
    def step(self) -> float:
        """Between two labels."""
        rough = (self.high - self.low) / _TICKS
        size = 10.0 ** math.floor(math.log10(rough))
        return next(size * factor for factor in (1.0, 2.0, 5.0, 10.0) if size * factor >= rough * (1 - 1e-9))

    @property
    def exponent(self) -> int:
        """The power of ten that the labels leave out."""
        largest = max(abs(self.low), abs(self.high))
        return 0 if 0.01 <= largest < 1e5 else 3 * math.floor(math.log10(largest) / 3)

    def ticks(self) -> list[tuple[float, str]]:
        """Values and their labels."""
        step, unit = self.step, 10.0**self.exponent
        decimals = max(0, -math.floor(math.log10(step / unit) + 1e-9))
        counts = range(math.ceil(self.low / step), math.floor(self.high / step) + 1)
        return [(n * step, f"{n * step / unit:.{decimals}f}".replace("-", "−")) for n in counts]


def padded(values: Sequence[float], start: float, end: float) -> Axis:
    """An axis that shows all values with some room; of equal ones, a little to both sides."""
    low, high = min(values), max(values)
    room, largest = _ROOM * (high - low), max(abs(low), abs(high))
    if largest == 0.0:
        room = 1.0
    elif room <= 1e-9 * largest:  # equal, or not to be told apart
        room = 0.05 * largest
    return Axis(low - room, high + room, start, end)


def power(axis: Axis) -> str:
    """The power of ten that an axis' labels leave out, as it is printed."""
    return text.raised(f"× 10^{axis.exponent}")


def text_at(x: float, y: float, words: str, anchor: str) -> Markup:
    """A text; `anchor` is SVG's: start, middle or end."""
    return Markup('<text x="{:.1f}" y="{:.1f}" text-anchor="{}">{}</text>').format(x, y, anchor, words)


def svg_of(width: float, height: float, font_size: float, parts: Sequence[Markup]) -> Markup:
    """A picture of these parts."""
    return Markup('<svg viewBox="0 0 {:.0f} {:.0f}" font-size="{}" fill="#444">{}</svg>').format(
        width, height, font_size, Markup("").join(parts)
    )
