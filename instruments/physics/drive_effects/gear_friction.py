"""Drive effect: friction of a gear that grows with the transmitted torque."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.drive_effects.effect import DriveEffect, DriveSignals, DriveStage
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class GearFriction(DriveEffect):
    """share·|τ|·sign ω: friction proportional to the torque that a gear or belt transmits."""

    share: float

    identifier: ClassVar[str] = "gear_friction"
    stage: ClassVar[DriveStage] = "transmission"
    words: ClassVar[str] = (
        "A gear, belt or loaded bearing rubs in proportion to the torque that it transmits, always against the motion:"
        " lifting a load takes more torque than lowering it gives back."
    )
    equation: ClassVar[str] = "τ → τ + share·|τ|·sign ω"
    coordinate: ClassVar[str] = "rate_sign"
    excited_by: ClassVar[str] = "slow motion both ways under different loads"
    look_alikes: ClassVar[tuple[str, ...]] = ("coulomb_friction", "stribeck_friction", "gravity")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "share": Parameter(
            unit="1",
            meaning="friction relative to the torque that is transmitted",
            low=0.0,
            high=1.0,
            role="size",
            scan=(1e-4,),
            zero=0.0,
        ),
    }

    def apply(self, signals: DriveSignals) -> FloatArray:
        """Return the torque with the friction of the gear."""
        return signals.torque_nm + self.share * np.abs(signals.torque_nm) * np.sign(signals.rate_rad_s)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The gear rubs with {100.0 * self.share:.3g} % of the torque that it transmits, against the motion:"
            " lifting takes more torque than lowering gives back."
        )
