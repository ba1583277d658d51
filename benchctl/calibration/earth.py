"""The Earth's rate along the axis of the table."""

from __future__ import annotations

import numpy as np

EARTH_DPS = 15.041 / 3600.0
"""The Earth's rotation against the stars, °/s."""


def earth_rate_dps(latitude_deg: float | None) -> float:
    """Its part along a vertical axis, positive counter-clockwise seen from above in the north; 0 where not known."""
    return 0.0 if latitude_deg is None else float(EARTH_DPS * np.sin(np.deg2rad(latitude_deg)))
