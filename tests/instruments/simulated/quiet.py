"""A simulated bench without noise, ripple or encoder error, so that its numbers can be held against closed forms."""

from __future__ import annotations

from typing import Any

from benchctl_instruments.simulated.settings import WorldSettings

QUIET: dict[str, Any] = {
    "gyro": {"arw_deg_per_sqrt_h": 0.0, "bias_walk_v_per_sqrt_s": 0.0},
    "table": {"ripple": 0.0},
    "encoder": {"eccentricity_arcsec": 0.0, "ellipticity_arcsec": 0.0},
    "chamber": {"thermistor_noise_c": 0.0},
    "latitude_deg": 0.0,
    "room_c": 20.0,
}


def quiet(**changed: Any) -> WorldSettings:
    """Quiet settings with fields of the top level changed."""
    return WorldSettings.from_mapping(QUIET | changed)
