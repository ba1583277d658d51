"""Drive effect: drift of the torque's zero."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.drive_effects.effect import DriveEffect, DriveSignals
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueDrift(DriveEffect):
    """A torque that is linear in time."""

    nm_per_hour: float

    identifier: ClassVar[str] = "torque_drift"
    words: ClassVar[str] = (
        "The zero of the torque moves steadily in the course of a run, whatever the motion: its sensor or "
        "amplifier warms."
    )
    equation: ClassVar[str] = "τ → τ + drift·t/3600"
    coordinate: ClassVar[str] = "time"
    excited_by: ClassVar[str] = "any long run"
    look_alikes: ClassVar[tuple[str, ...]] = ("viscous_warm_up", "torque_offset")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "nm_per_hour": Parameter(
            unit="N m h-1",
            meaning="torque gained in an hour",
            low=-1e5,
            high=1e5,
            role="size",
            scan=(1e-4,),
            zero=0.0,
        ),
    }

    def apply(self, signals: DriveSignals) -> FloatArray:
        """Return the torque with a drifting zero."""
        return signals.torque_nm + self.nm_per_hour * signals.time_s / 3600.0

    def says(self) -> str:
        """Return the finding in one sentence."""
        return f"The zero of the torque drifts by {self.nm_per_hour:.3g} N·m an hour."
