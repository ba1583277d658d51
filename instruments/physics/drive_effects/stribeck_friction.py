"""Drive effect: Stribeck friction, which falls as a lubricating film forms in the bearing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy  # scipy.special is loaded on first use

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.drive_effects.effect import DriveEffect, DriveSignals
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class StribeckFriction(DriveEffect):
    """breakaway·exp(−(ω/velocity)²)·sign ω, in addition to Coulomb friction (Stribeck)."""

    breakaway_nm: float
    velocity_rad_s: float

    identifier: ClassVar[str] = "stribeck_friction"
    words: ClassVar[str] = (
        "At creeping rates the friction is larger than when the bearing floats on its lubricant: the table sticks "
        "and slips."
    )
    equation: ClassVar[str] = "τ → τ + breakaway·exp(−(ω/velocity)²)·sign ω"
    coordinate: ClassVar[str] = "abs_rate"
    excited_by: ClassVar[str] = "slow sweeps through zero in both directions"
    look_alikes: ClassVar[tuple[str, ...]] = ("coulomb_friction",)
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "breakaway_nm": Parameter(
            unit="N m",
            meaning="friction at creeping rates beyond that at high ones",
            low=0.0,
            high=1e4,
            role="size",
            scan=(1e-5,),
            zero=0.0,
        ),
        "velocity_rad_s": Parameter(
            unit="rad s-1",
            meaning="rate at which it has fallen to 1/e",
            low=1e-4,
            high=1.0,
            role="shape",
            scan=(0.003, 0.01, 0.03, 0.1, 0.3),
            logarithmic=True,
        ),
    }

    def apply(self, signals: DriveSignals) -> FloatArray:
        """Return the torque with the friction at creeping rates."""
        velocity = self.velocity_rad_s
        creeping = signals.mean_of(
            lambda rate: np.exp(-((rate / velocity) ** 2)) * np.sign(rate),
            lambda rate: 0.5 * math.sqrt(math.pi) * velocity * scipy.special.erf(np.abs(rate) / velocity),
        )
        return signals.torque_nm + self.breakaway_nm * creeping

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"Below about {self.velocity_rad_s:.3g} rad/s friction grows by up to {self.breakaway_nm:.3g} N·m:"
            " the bearing no longer floats on its lubricant."
        )
