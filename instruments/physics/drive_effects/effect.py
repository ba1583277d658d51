"""Base class of drive effects and the signals that they use: the motion of the table and its torque.

The baseline is a rigid body in a viscous bearing, torque = J·dω/dt + b·ω; an effect adds a missing term.
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
"""`friction`: an additional torque; `transmission`: a change of the total torque on its way; `measurement`: an error of
its measurement. They act in this order."""

_EVEN = 1e-6
"""A negligible change of the rate within a sample, as a fraction of the largest rate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveSignals:
    """A segment without gaps; arrays have shape (n,).

    `time_s` counts from the start of the run; angle positive counter-clockwise, unwrapped. `torque_nm` is the torque of
    the drive on the table, after the effects applied so far. `inertia_kg_m2` and `viscous_nm_s` [N·m·s/rad] are those
    of the baseline.
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
        """Return the mean over a sample of a friction of the rate, for a linear rate; `integral` is over the rate."""
        half = 0.5 * self.interval_s * self.acceleration_rad_s2
        first, last = self.rate_rad_s - half, self.rate_rad_s + half
        evenly = np.abs(half) <= _EVEN * np.abs(self.rate_rad_s).max()
        change = np.where(evenly, 1.0, last - first)
        return np.where(evenly, friction(self.rate_rad_s), (integral(last) - integral(first)) / change)


class DriveEffect(DescribedEffect):
    """A drive effect; `stage` orders effects that do not commute."""

    stage: ClassVar[DriveStage] = "friction"

    @abstractmethod
    def apply(self, signals: DriveSignals) -> FloatArray:
        """Return the torque [N·m] with the effect, shape (n,)."""
