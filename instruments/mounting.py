"""Mounting positions of a gyro. Separate from `interfaces`, which needs numpy: plans are read without it."""

from __future__ import annotations

from typing import Literal

Position = Literal["along", "across"]
"""The input axis is along the table's axis, as usual, or perpendicular to it."""
