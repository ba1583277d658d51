"""What a picture shows, as data: panels of curves above each other, with a caption."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

Look = Literal["off", "on", "third", "grey", "faint", "off dots", "on dots", "third dots"]
"""`off` is without the effect, `on` with it; `grey` and `faint` stand back."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """A line, or dots; x and y of shape (n,)."""

    x: FloatArray
    y: FloatArray
    look: Look
    label: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Band:
    """A range of x (or of y, `across`) that has a name."""

    low: float
    high: float
    label: str
    look: Literal["good", "open", "bad"]
    across: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One pair of axes. `in_rate`: beside volts the rates that they stand for [°/s]. `share` of the height."""

    x: str
    y: str
    curves: tuple[Curve, ...]
    bands: tuple[Band, ...] = ()
    marks: tuple[tuple[float, float, str], ...] = ()
    logarithmic: Literal["", "x", "xy"] = ""
    zero: bool = False
    share: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sketch:
    """A whole picture; `difference`, shape (n,), is what the effect changes, where it shows one."""

    title: str
    caption: str
    panels: tuple[Panel, ...]
    difference: FloatArray | None = None
