"""Mounting positions of a gyro. Separate from `interfaces`, which needs numpy: plans are read without it."""

from __future__ import annotations

from typing import Literal, get_args

AxisPosition = Literal["x up", "x down", "y up", "y down", "z down", "z up"]
"""The axis of a unit of three axes that is parallel to the table's axis, and its direction."""

Position = Literal["along", "across", AxisPosition]
"""The input axis is along the table's axis, as usual, or perpendicular to it; or that of a unit of three axes."""

AXES = ("x", "y", "z")
AXIS_POSITIONS: tuple[AxisPosition, ...] = get_args(AxisPosition)


def vertical(position: str) -> tuple[int, int]:
    """Return the index of the axis that is vertical in one of `AXIS_POSITIONS`, and 1 if it points up, -1 if down."""
    axis, way = position.split()
    return AXES.index(axis), 1 if way == "up" else -1
