"""Effect: interpolation error of the encoder between the lines of its grating."""

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


_MOST_OF_PITCH = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderInterpolation(EncoderEffect):
    """The encoder reads θ + amplitude·sin(lines·θ + phase) (domain facts, SDE)."""

    amplitude_arcsec: float
    lines_per_rev: float
    phase_deg: float = 0.0

    identifier: ClassVar[str] = "encoder_interpolation"
    stage: ClassVar[Stage] = "sampling"
    words: ClassVar[str] = (
        "Between the lines of its grating the encoder interpolates, and does so a little wrongly, in the same way from"
        " every line to the next. The table seems to tremble in step with the lines; the gyro does not feel it."
    )
    equation: ClassVar[str] = "θ_encoder = θ + amplitude·sin(lines·θ + phase)"
    coordinate: ClassVar[str] = "angle"
    excited_by: ClassVar[str] = "rates at which the lines pass more slowly than half the sample rate"
    look_alikes: ClassVar[tuple[str, ...]] = ("encoder_eccentricity", "heading_dependent_bias", "mains_pickup")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "amplitude_arcsec": Parameter(
            unit="arcsec", meaning="largest error of angle", low=0.0, high=3600.0, role="size", scan=(0.01,), zero=0.0
        ),
        "lines_per_rev": Parameter(
            unit="1",
            meaning="lines of the grating in a turn",
            low=5.0,
            high=100_000.0,
            role="choice",
            scan=(36.0, 1024.0, 9000.0, 36_000.0),
            by_scan=True,
        ),
        "phase_deg": Parameter(
            unit="degree",
            meaning="phase of the sine at angle 0, a turn from line to line",
            low=0.0,
            high=360.0,
            role="phase",
            scan=(0.0, 90.0),
        ),
    }

    @property
    def plausible(self) -> bool:
        """Whether the error is a small fraction of the line spacing, which is what is interpolated."""
        return self.amplitude_arcsec <= _MOST_OF_PITCH * 360.0 * 3600.0 / self.lines_per_rev

    def error_deg(self, angle_deg: FloatArray) -> FloatArray:
        """Return the error [deg] at true angles [deg]."""
        error: FloatArray = self.amplitude_arcsec / 3600.0 * np.sin(self._argument(angle_deg))
        return error

    def error_slope(self, angle_deg: FloatArray) -> FloatArray:
        """Return the derivative of the error with respect to the angle."""
        steepest = self.amplitude_arcsec * _RAD_PER_ARCSEC * self.lines_per_rev
        slope: FloatArray = steepest * np.cos(self._argument(angle_deg))
        return slope

    @property
    def waves_a_turn(self) -> float:
        """The number of lines."""
        return self.lines_per_rev

    def _argument(self, angle_deg: FloatArray) -> FloatArray:
        argument: FloatArray = np.radians(self.lines_per_rev * angle_deg + self.phase_deg)
        return argument

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The encoder is wrong by {self.amplitude_arcsec:.3g} arcsec from line to line, {self.lines_per_rev:.0f}"
            " times a turn: its rate seems to tremble, and the gyro does not feel it."
        )
