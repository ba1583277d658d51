"""Effect: eccentricity of the encoder's grating."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Stage
from benchctl_instruments.physics.effects.effect import Parameter
from benchctl_instruments.physics.effects.kinds import EncoderEffect

_RAD_PER_ARCSEC = np.radians(1.0 / 3600.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderEccentricity(EncoderEffect):
    """The encoder reads θ + amplitude·sin(order·(θ − phase)) (domain facts, ECC)."""

    amplitude_arcsec: float
    phase_deg: float
    order: float = 1.0

    identifier: ClassVar[str] = "encoder_eccentricity"
    stage: ClassVar[Stage] = "sampling"
    words: ClassVar[str] = (
        "The encoder's grating sits a little off the axis, so that the angle it states is wrong by a sine of one turn"
        " (order 2: an ellipse). The table seems to speed up and slow down once a turn; the gyro does not feel it."
    )
    equation: ClassVar[str] = "θ_encoder = θ + amplitude·sin(order·(θ − phase))"
    coordinate: ClassVar[str] = "angle"
    excited_by: ClassVar[str] = "complete turns at a high rate"
    look_alikes: ClassVar[tuple[str, ...]] = ("heading_dependent_bias", "encoder_interpolation")
    several: ClassVar[bool] = True
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "amplitude_arcsec": Parameter(
            unit="arcsec", meaning="largest error of angle", low=0.0, high=3600.0, role="size", scan=(1.0,), zero=0.0
        ),
        "phase_deg": Parameter(
            unit="degree",
            meaning="an angle at which it is right",
            low=0.0,
            high=360.0,
            role="phase",
            scan=(0.0, 45.0, 90.0),
        ),
        "order": Parameter(unit="1", meaning="errors in a turn", low=1.0, high=4.0, role="choice", scan=(1.0, 2.0)),
    }

    def error_deg(self, angle_deg: FloatArray) -> FloatArray:
        """Return the error [deg] at true angles [deg]."""
        error: FloatArray = self.amplitude_arcsec / 3600.0 * np.sin(self._argument(angle_deg))
        return error

    def error_slope(self, angle_deg: FloatArray) -> FloatArray:
        """Return the derivative of the error with respect to the angle."""
        slope: FloatArray = self.amplitude_arcsec * _RAD_PER_ARCSEC * self.order * np.cos(self._argument(angle_deg))
        return slope

    @property
    def waves_a_turn(self) -> float:
        """The order."""
        return self.order

    def _argument(self, angle_deg: FloatArray) -> FloatArray:
        argument: FloatArray = np.radians(self.order * (angle_deg - self.phase_deg))
        return argument

    def says(self) -> str:
        """Return the finding in one sentence."""
        often = {1: "once", 2: "twice"}.get(round(self.order), f"{self.order:.0f} times")
        return (
            f"The encoder is wrong by {self.amplitude_arcsec:.3g} arcsec, {often} a turn:"
            " its rate seems to change with the angle, and the gyro does not feel it."
        )
