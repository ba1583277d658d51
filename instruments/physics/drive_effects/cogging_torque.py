"""Drive effect: cogging torque of the motor's magnets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.drive_effects.effect import DriveEffect, DriveSignals
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class CoggingTorque(DriveEffect):
    """amplitude·cos(order·(θ−phase)); order 1 is an unbalance, which `gravity` describes."""

    amplitude_nm: float
    phase_deg: float
    order: float = 1.0

    identifier: ClassVar[str] = "cogging_torque"
    words: ClassVar[str] = (
        "The torque depends on the angle, several times a turn: the magnets of the motor hold at its teeth, or a "
        "bearing runs untrue."
    )
    equation: ClassVar[str] = "τ → τ + amplitude·cos(order·(θ−phase))"
    coordinate: ClassVar[str] = "angle"
    excited_by: ClassVar[str] = "slow complete turns"
    look_alikes: ClassVar[tuple[str, ...]] = ("gravity", "torque_offset")
    several: ClassVar[bool] = True
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "amplitude_nm": Parameter(
            unit="N m",
            meaning="largest torque",
            low=0.0,
            high=1e4,
            role="size",
            scan=(1e-5,),
            zero=0.0,
        ),
        "phase_deg": Parameter(
            unit="degree",
            meaning="an angle of the largest torque",
            low=0.0,
            high=360.0,
            role="phase",
            scan=(0.0, 45.0, 90.0),
        ),
        "order": Parameter(
            unit="1",
            meaning="periods in a turn",
            low=1.0,
            high=360.0,
            role="choice",
            scan=tuple(float(order) for order in range(2, 73)),
        ),
    }

    def apply(self, signals: DriveSignals) -> FloatArray:
        """Return the torque with the angle-dependent part; the rate is assumed constant within a sample."""
        turn = np.radians(self.order * (signals.angle_deg - self.phase_deg))
        within = self.order * signals.rate_rad_s * signals.interval_s / (2 * np.pi)
        return signals.torque_nm + self.amplitude_nm * np.cos(turn) * np.sinc(within)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The torque changes by ±{self.amplitude_nm:.3g} N·m with the angle, {self.order:.0f} times a turn:"
            f" it is largest at {self.phase_deg % (360.0 / self.order):.3g}°."
        )
