"""Effect: dependence of the bias on the gyro's heading."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingDependentBias(PhysicalEffect):
    """U + amplitude·cos(order·(θ−phase)) (domain facts, MAG, EARTH)."""

    amplitude_v: float
    phase_deg: float
    order: float = 1.0

    identifier: ClassVar[str] = "heading_dependent_bias"
    stage: ClassVar[Stage] = "bias"
    pointwise: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The bias changes with the heading, by the same volts at any rate: a magnetic field acts on the coil, or a"
        " tilted axis sees a part of the Earth's rotation once a turn. The encoder does not see it."
    )
    equation: ClassVar[str] = "U → U + amplitude·cos(order·(θ−phase))"
    coordinate: ClassVar[str] = "angle"
    excited_by: ClassVar[str] = "slow complete turns, or rest at several headings"
    look_alikes: ClassVar[tuple[str, ...]] = ("encoder_eccentricity", "encoder_interpolation")
    several: ClassVar[bool] = True
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "amplitude_v": Parameter(
            unit="V", meaning="largest shift of the bias", low=0.0, high=10.0, role="size", scan=(1e-6,), zero=0.0
        ),
        "phase_deg": Parameter(
            unit="degree",
            meaning="an angle of the largest shift",
            low=0.0,
            high=360.0,
            role="phase",
            scan=(0.0, 45.0, 90.0),
        ),
        "order": Parameter(unit="1", meaning="periods in a turn", low=1.0, high=4.0, role="choice", scan=(1.0, 2.0)),
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with the bias at the table's angle."""
        volts = signals.angle_deg - self.phase_deg
        volts *= math.radians(self.order)
        np.cos(volts, out=volts)
        volts *= self.amplitude_v
        volts += signals.output_v
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        often = {1: "once", 2: "twice"}.get(round(self.order), f"{self.order:.0f} times")
        return (
            f"The bias changes by ±{1e3 * self.amplitude_v:.3g} mV with the heading, {often} a turn and at any rate:"
            f" it is largest at {self.phase_deg % (360.0 / self.order):.0f}°."
        )
