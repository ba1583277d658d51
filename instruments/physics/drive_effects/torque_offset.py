"""Drive effect: an offset of the torque."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.drive_effects.effect import DriveEffect, DriveSignals
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueOffset(DriveEffect):
    """A constant added to the torque, independent of the direction."""

    offset_nm: float

    identifier: ClassVar[str] = "torque_offset"
    words: ClassVar[str] = (
        "The torque is off by a constant that does not turn with the direction: the zero of its sensor or current "
        "probe, or a pull that is always the same."
    )
    equation: ClassVar[str] = "τ → τ + offset"
    coordinate: ClassVar[str] = "output"
    excited_by: ClassVar[str] = "rotation in both directions"
    look_alikes: ClassVar[tuple[str, ...]] = ("coulomb_friction",)
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "offset_nm": Parameter(
            unit="N m",
            meaning="the constant",
            low=-1e4,
            high=1e4,
            role="size",
            scan=(1e-5,),
            zero=0.0,
        ),
    }

    def apply(self, signals: DriveSignals) -> FloatArray:
        """Return the torque with its offset."""
        return signals.torque_nm + self.offset_nm

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The torque is off by {self.offset_nm:.3g} N·m in both directions alike: the zero of its measurement,"
            " or a steady pull."
        )
