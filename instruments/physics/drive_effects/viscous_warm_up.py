"""Drive effect: warm-up of the grease."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.drive_effects.effect import DriveEffect, DriveSignals
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class ViscousWarmUp(DriveEffect):
    """b changes exponentially during a run: grease is less stiff when warm.

    `fraction` is the change at the end of a run of `duration_s`: this is well determined even if tau is long.
    """

    fraction: float
    tau_s: float
    duration_s: float = 3600.0

    identifier: ClassVar[str] = "viscous_warm_up"
    words: ClassVar[str] = (
        "The lubricant is stiffer while the bearing is cold: viscous friction falls in the course of a run."
    )
    equation: ClassVar[str] = "b → b·(1 + fraction·(1 − e^(−t/tau))/(1 − e^(−duration/tau)))"
    coordinate: ClassVar[str] = "time"
    excited_by: ClassVar[str] = "a long run from a cold start"
    look_alikes: ClassVar[tuple[str, ...]] = ("quadratic_drag", "torque_drift")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "fraction": Parameter(
            unit="1",
            meaning="change at the end of the run, relative to the friction at its start",
            low=-1.0,
            high=10.0,
            role="size",
            scan=(1e-4,),
            zero=0.0,
        ),
        "tau_s": Parameter(
            unit="s",
            meaning="time constant",
            low=0.5,
            high=1e5,
            role="shape",
            scan=(3.0, 10.0, 30.0, 100.0, 300.0, 1000.0),
            logarithmic=True,
        ),
    }

    def apply(self, signals: DriveSignals) -> FloatArray:
        """Return the torque with the friction of warming grease."""
        change = self.fraction * np.expm1(-signals.time_s / self.tau_s) / math.expm1(-self.duration_s / self.tau_s)
        return signals.torque_nm + signals.viscous_nm_s * signals.rate_rad_s * change

    def says(self) -> str:
        """Return the finding in one sentence."""
        way = "falls" if self.fraction < 0.0 else "grows"
        return (
            f"Viscous friction {way} by {100.0 * abs(self.fraction):.3g} % in the course of a run, with a time constant"
            f" of {self.tau_s:.3g} s: the lubricant warms or wanders."
        )
