"""What the encoder reads of the table's angle."""

from __future__ import annotations

import numpy as np

from tests.benchctl.diagnosis.foreign.linear import FloatArray
from tests.benchctl.diagnosis.foreign.truth import Effects

_ARCSEC_PER_DEG = 3600.0


def angle_error(effects: Effects, angle_deg: FloatArray, line_phase_rad: float) -> FloatArray:
    """What the encoder reads too much (°): eccentricity, and interpolation between its lines."""
    error = np.zeros_like(angle_deg)
    if off := effects.get("encoder_eccentricity"):
        turn = np.deg2rad(off["order"] * (angle_deg - off["phase_deg"]))
        error += off["amplitude_arcsec"] / _ARCSEC_PER_DEG * np.sin(turn)
    if lines := effects.get("encoder_interpolation"):
        turn = np.deg2rad(lines["lines_per_rev"] * angle_deg) + line_phase_rad
        error += lines["amplitude_arcsec"] / _ARCSEC_PER_DEG * np.sin(turn)
    return error


def read(
    angle_deg: FloatArray, error_deg: FloatArray, counts_per_rev: int, noise_arcsec: float, rng: np.random.Generator
) -> FloatArray:
    """The encoder's reading, in whole counts, 0 to 360°."""
    noisy = angle_deg + error_deg + rng.normal(0.0, noise_arcsec / _ARCSEC_PER_DEG, angle_deg.size)
    counts = np.round(noisy * (counts_per_rev / 360.0)) % counts_per_rev
    return counts * (360.0 / counts_per_rev)
