"""The encoder interpolates between the lines of its grating, a little wrongly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from instruments.interfaces import FloatArray
from instruments.physics.chain import Stage
from instruments.physics.effects.effect import Parameter
from instruments.physics.effects.kinds import EncoderEffect

_RAD_PER_ARCSEC = np.radians(1.0 / 3600.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderInterpolation(EncoderEffect):
    """The encoder reads θ + amplitude·sin(lines·θ), right on every line (domain facts, SDE)."""

    amplitude_arcsec: float
    lines_per_rev: float

    identifier: ClassVar[str] = "encoder_interpolation"
    stage: ClassVar[Stage] = "sampling"
    words: ClassVar[str] = (
        "Between the lines of its grating the encoder interpolates, and does so a little wrongly, in the same way from"
        " every line to the next. The table seems to tremble in step with the lines; the gyro does not feel it."
    )
    equation: ClassVar[str] = "θ_encoder = θ + amplitude·sin(lines·θ)"
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
            role="shape",
            scan=tuple(
                float(lines)
                for lines in (
                    *(32, 36, 50, 60, 64, 72, 90, 100, 120, 128, 144, 180, 200, 250, 256, 360, 400, 500, 512, 600, 720),
                    *(900, 1000, 1024, 1250, 1800, 2000, 2048, 2500, 3600, 4096, 5000, 7200, 8192, 9000, 10_000),
                    *(16_384, 18_000, 20_000, 32_768, 36_000),
                )
            ),
            logarithmic=True,
        ),
    }

    def error_deg(self, angle_deg: FloatArray) -> FloatArray:
        """What it adds to true angles [deg]."""
        error: FloatArray = self.amplitude_arcsec / 3600.0 * np.sin(np.radians(self.lines_per_rev * angle_deg))
        return error

    def error_slope(self, angle_deg: FloatArray) -> FloatArray:
        """The derivative of the error by the angle."""
        steepest = self.amplitude_arcsec * _RAD_PER_ARCSEC * self.lines_per_rev
        slope: FloatArray = steepest * np.cos(np.radians(self.lines_per_rev * angle_deg))
        return slope

    def says(self) -> str:
        """The finding in one sentence."""
        return (
            f"The encoder is wrong by {self.amplitude_arcsec:.3g} arcsec from line to line, {self.lines_per_rev:.0f}"
            " times a turn: its rate seems to tremble, and the gyro does not feel it."
        )
