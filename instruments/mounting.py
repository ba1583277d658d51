"""How a gyro stands on the table. Apart from `interfaces`, which need numpy: plans are read without it."""

from __future__ import annotations

from typing import Literal

Position = Literal["along", "across"]
"""Its input axis along the table's axis, as usual, or perpendicular to it."""
