"""Drive effect: a load with its centre of mass off the axis: a pendulum, or an unbalanced table that is not level."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.drive_effects.effect import DriveEffect, DriveSignals
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Gravity(DriveEffect):
    """moment·sin(θ−hangs_at), moment = m·g·l·sin of the axis' tilt from the vertical: the torque of an unbalance."""

    moment_nm: float
    hangs_at_deg: float

    identifier: ClassVar[str] = "gravity"
    words: ClassVar[str] = (
        "The load is out of balance and its axis is not vertical: gravity pulls it to the angle at which it hangs, "
        "with m·g·l·sin θ."
    )
    equation: ClassVar[str] = "τ → τ + moment·sin(θ−hangs_at),  moment = m·g·l"
    coordinate: ClassVar[str] = "angle"
    excited_by: ClassVar[str] = "slow motion over a good part of a turn"
    look_alikes: ClassVar[tuple[str, ...]] = ("cogging_torque", "torque_offset")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "moment_nm": Parameter(
            unit="N m",
            meaning="largest torque, m·g·l",
            low=0.0,
            high=1e4,
            role="size",
            scan=(1e-5,),
            zero=0.0,
        ),
        "hangs_at_deg": Parameter(
            unit="degree",
            meaning="angle at which the load hangs",
            low=0.0,
            high=360.0,
            role="phase",
            scan=(0.0, 45.0, 90.0),
        ),
    }

    def apply(self, signals: DriveSignals) -> FloatArray:
        """Return the torque with the gravity torque; the rate is assumed constant within a sample."""
        within = signals.rate_rad_s * signals.interval_s / (2 * np.pi)
        lifted = np.sin(np.radians(signals.angle_deg - self.hangs_at_deg)) * np.sinc(within)
        return signals.torque_nm + self.moment_nm * lifted

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"Gravity pulls the load to {self.hangs_at_deg % 360.0:.3g}° with {self.moment_nm:.3g} N·m·sin θ: it is"
            " out of balance, like a pendulum."
        )
