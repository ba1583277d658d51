"""The angle encoder of the table: from the true angle to a quadrature count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import UsageError

DEG_PER_ARCSEC = 1.0 / 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderParameters:
    """An encoder with the errors amplitude·sin(order·(θ − phase)): eccentricity is order 1, ellipticity 2.

    The default amplitudes add up to an accuracy of 20″. `sign` is -1 if the count falls while the table turns
    counter-clockwise.
    """

    counts_per_rev: int = 360_000
    eccentricity_arcsec: float = 15.0
    eccentricity_phase_deg: float = 40.0
    ellipticity_arcsec: float = 5.0
    ellipticity_phase_deg: float = 110.0
    sign: int = 1

    def __post_init__(self) -> None:
        if self.counts_per_rev <= 0 or self.sign not in (-1, 1):
            raise UsageError(
                f"an encoder of {self.counts_per_rev} counts a revolution, sign {self.sign};"
                " give counts above 0 and sign 1 or -1"
            )


def encoder_angle_deg(parameters: EncoderParameters, angle_deg: FloatArray) -> FloatArray:
    """Return the encoder's angle [deg] without quantization, for true angles [deg], shape (n,), unwrapped."""
    error_arcsec = parameters.eccentricity_arcsec * np.sin(
        np.radians(angle_deg - parameters.eccentricity_phase_deg)
    ) + parameters.ellipticity_arcsec * np.sin(2.0 * np.radians(angle_deg - parameters.ellipticity_phase_deg))
    return angle_deg + error_arcsec * DEG_PER_ARCSEC


def quadrature_count(parameters: EncoderParameters, encoder_deg: FloatArray) -> IntArray:
    """Return the unwrapped count, shape (n,): the number of complete steps since angle zero, rounded down (floor)."""
    steps = np.floor(encoder_deg * (parameters.sign * parameters.counts_per_rev / 360.0))
    return steps.astype(np.int64)
