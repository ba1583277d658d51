"""What an effect of a table's drive works on: the motion as it is, and the torque that it takes.

The baseline is a rigid body in a viscous bearing, torque = J·dω/dt + b·ω; an effect adds what it leaves out.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.effect import DescribedEffect

DriveStage = Literal["friction", "transmission", "measurement"]
"""`friction`: a torque of its own; `transmission`: what all of it takes on its way; `measurement`: how all of it is
measured. They act in this order."""

_EVEN = 1e-6
"""A change of the rate within a sample, as a share of the largest rate, that does not show."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveSignals:
    """A stretch without gaps; arrays of shape (n,).

    `time_s` counts from the start of the run; angle positive counter-clockwise, unwrapped. `torque_nm` is that of the
    drive on the table, as far as the effects before have made it. `inertia_kg_m2` and `viscous_nm_s` [N·m·s/rad] are
    those of the baseline.
    """

    time_s: FloatArray
    interval_s: float
    angle_deg: FloatArray
    rate_rad_s: FloatArray
    acceleration_rad_s2: FloatArray
    torque_nm: FloatArray
    inertia_kg_m2: float
    viscous_nm_s: float

    def mean_of(
        self, friction: Callable[[FloatArray], FloatArray], integral: Callable[[FloatArray], FloatArray]
    ) -> FloatArray:
        """A friction of the rate, averaged over a sample in which that changes evenly; `integral` is over the rate."""
        half = 0.5 * self.interval_s * self.acceleration_rad_s2
        first, last = self.rate_rad_s - half, self.rate_rad_s + half
        evenly = np.abs(half) <= _EVEN * np.abs(self.rate_rad_s).max()
        change = np.where(evenly, 1.0, last - first)
        return np.where(evenly, friction(self.rate_rad_s), (integral(last) - integral(first)) / change)


class DriveEffect(DescribedEffect):
    """Physics of a drive; `stage` orders effects that do not commute."""

    stage: ClassVar[DriveStage] = "friction"

    @abstractmethod
    def apply(self, signals: DriveSignals) -> FloatArray:
        """The torque [N·m] with the effect, shape (n,)."""
