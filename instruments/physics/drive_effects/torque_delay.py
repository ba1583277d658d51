"""Drive effect: a delay between the torque and its time stamp."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.drive_effects.effect import DriveEffect, DriveSignals, DriveStage
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueDelay(DriveEffect):
    """τ(t − delay): the torque is older than its stamp (negative: the angle is)."""

    delay_s: float

    identifier: ClassVar[str] = "torque_delay"
    stage: ClassVar[DriveStage] = "measurement"
    words: ClassVar[str] = (
        "Torque and angle are not of the same instant: one of the two is sampled or filtered later than the other."
    )
    equation: ClassVar[str] = "τ(t) → τ(t − delay)"
    coordinate: ClassVar[str] = "acceleration"
    excited_by: ClassVar[str] = "sudden changes of the torque"
    look_alikes: ClassVar[tuple[str, ...]] = ("quadratic_drag",)
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "delay_s": Parameter(
            unit="s",
            meaning="by how much the torque is older than its stamp",
            low=-1.0,
            high=1.0,
            role="size",
            scan=(1e-4,),
            zero=0.0,
        ),
    }

    def apply(self, signals: DriveSignals) -> FloatArray:
        """Return the shifted torque, interpolated linearly between samples and held at the ends."""
        return np.interp(signals.time_s - self.delay_s, signals.time_s, signals.torque_nm)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The {'torque' if self.delay_s > 0.0 else 'angle'} is {1e3 * abs(self.delay_s):.3g} ms older"
            f" than the {'angle' if self.delay_s > 0.0 else 'torque'} of the same stamp."
        )
