"""Drive effect: aerodynamic drag."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.drive_effects.effect import DriveEffect, DriveSignals
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class QuadraticDrag(DriveEffect):
    """drag·ω·|ω|: turbulent air, or a fan on the shaft."""

    drag_nm_s2: float

    identifier: ClassVar[str] = "quadratic_drag"
    words: ClassVar[str] = (
        "The torque grows with the square of the rate: the air around a fast table, or a fan on its shaft, resists."
    )
    equation: ClassVar[str] = "τ → τ + drag·ω·|ω|"
    coordinate: ClassVar[str] = "abs_rate"
    excited_by: ClassVar[str] = "three or more rates up to the highest"
    look_alikes: ClassVar[tuple[str, ...]] = ("coulomb_friction", "viscous_warm_up")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "drag_nm_s2": Parameter(
            unit="N m s2 rad-2",
            meaning="torque per square of the rate",
            low=0.0,
            high=1e2,
            role="size",
            scan=(1e-9,),
            zero=0.0,
        ),
    }

    def apply(self, signals: DriveSignals) -> FloatArray:
        """Return the torque with the drag of the air."""
        return signals.torque_nm + self.drag_nm_s2 * signals.rate_rad_s * np.abs(signals.rate_rad_s)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return f"Torque grows with the square of the rate, by {self.drag_nm_s2:.3g} N·m/(rad/s)²: the air resists."
