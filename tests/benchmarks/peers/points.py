"""What every recorder of single points is given, and what is asked of it: a stamp and three channels a point."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchctl_instruments.errors import UsageError

NAMES = ("time_s", "encoder_deg", "gyro_v", "gyro_temp_c")

Point = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Spent:
    """Wall time for the points alone, until the last is where the recorder keeps it, and from opening to closing.

    `stored` is how many points are read back afterwards.
    """

    points_s: float
    whole_s: float
    stored: int


Recorder = Callable[[Sequence[Point], Path], Spent]
"""Records points into an empty folder."""


def made(count: int) -> list[Point]:
    """Points as a bench has them: a millisecond apart, none like another."""
    return [(i * 1e-3, i * 0.5 % 360.0, 0.5 + 1e-5 * i, 25.0 + 1e-6 * i) for i in range(count)]


def installed(module: str) -> Any:
    """A peer's module; raises `UsageError` where it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError as err:
        raise UsageError(
            f"{module} is not there to be compared with: pip install 'benchctl[benchmarks]' ({err})"
        ) from err
