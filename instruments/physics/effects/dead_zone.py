"""Effect: no response to small rates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class DeadZone(PhysicalEffect):
    """No response for |ω| < half_width; outside, the characteristic is shifted by half_width (domain facts, DEAD)."""

    half_width_dps: float

    identifier: ClassVar[str] = "dead_zone"
    stage: ClassVar[Stage] = "sensed_rate"
    pointwise: ClassVar[bool] = True
    momentary: ClassVar[bool] = True
    words: ClassVar[str] = (
        "Below a certain rate the gyro does not answer at all, and beyond it the answer lacks just that rate: the two"
        " beams are coupled, or the demodulator does not see small phases."
    )
    equation: ClassVar[str] = "ω → ω − min(max(ω, −half_width), half_width)"
    coordinate: ClassVar[str] = "rate_sign"
    excited_by: ClassVar[str] = "slow sweeps through zero, and both directions at several rates"
    look_alikes: ClassVar[tuple[str, ...]] = ("rate_nonlinearity",)
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "half_width_dps": Parameter(
            unit="degree/s",
            meaning="the largest rate without an answer",
            low=0.0,
            high=50.0,
            role="size",
            scan=(0.005,),
            zero=0.0,
        )
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the rate after the dead zone."""
        kept = np.clip(signals.sensed_rate_dps, -self.half_width_dps, self.half_width_dps)
        np.subtract(signals.sensed_rate_dps, kept, out=kept)
        return replace(signals, sensed_rate_dps=kept)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The gyro does not answer to rates below {self.half_width_dps:.3g} °/s, and all others come out smaller"
            " by that much."
        )
