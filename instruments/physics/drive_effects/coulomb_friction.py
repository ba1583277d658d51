"""Drive effect: dry friction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.drive_effects.effect import DriveEffect, DriveSignals
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class CoulombFriction(DriveEffect):
    """coulomb·sign ω: dry friction of bearings, brushes and slip rings."""

    coulomb_nm: float

    identifier: ClassVar[str] = "coulomb_friction"
    words: ClassVar[str] = (
        "The bearings, brushes and slip rings of the table rub with the same torque at any rate, always against "
        "the motion."
    )
    equation: ClassVar[str] = "τ → τ + coulomb·sign ω"
    coordinate: ClassVar[str] = "rate_sign"
    excited_by: ClassVar[str] = "rotation in both directions, and at more than one rate"
    look_alikes: ClassVar[tuple[str, ...]] = ("torque_offset", "stribeck_friction", "quadratic_drag")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "coulomb_nm": Parameter(
            unit="N m",
            meaning="torque of the dry friction",
            low=0.0,
            high=1e4,
            role="size",
            scan=(1e-5,),
            zero=0.0,
        ),
    }

    def apply(self, signals: DriveSignals) -> FloatArray:
        """Return the torque with dry friction."""
        return signals.torque_nm + self.coulomb_nm * signals.mean_of(np.sign, np.abs)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return f"Dry (Coulomb) friction of {self.coulomb_nm:.3g} N·m works against the motion at any rate."
