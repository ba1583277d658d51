"""Effect: an offset between the gyro's sampling instants and their stamps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Stage
from benchctl_instruments.physics.effects.effect import Parameter
from benchctl_instruments.physics.effects.kinds import ClockEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class TimingOffset(ClockEffect):
    """At stamp t the gyro is sampled at t − offset, the encoder at t (domain facts, DELAY)."""

    offset_s: float

    identifier: ClassVar[str] = "timing_offset"
    stage: ClassVar[Stage] = "sampling"
    words: ClassVar[str] = (
        "Encoder and gyro do not share one instant: the gyro's samples are older (or, negative, younger) than the"
        " encoder's in the same rows, by always the same time."
    )
    equation: ClassVar[str] = "U(t) → U(t − offset)"
    coordinate: ClassVar[str] = "acceleration"
    excited_by: ClassVar[str] = "reversals and oscillations"
    look_alikes: ClassVar[tuple[str, ...]] = ("angular_acceleration", "sensor_bandwidth", "clock_drift")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "offset_s": Parameter(
            unit="s",
            meaning="age of the gyro's samples when they are stamped",
            low=-0.5,
            high=0.5,
            role="size",
            scan=(1e-5,),
            zero=0.0,
        )
    }

    def gyro_time_s(self, stamp_s: FloatArray) -> FloatArray:
        """Return the sampling instants [s] of the gyro."""
        return stamp_s - self.offset_s

    def says(self) -> str:
        """Return the finding in one sentence."""
        older = "older" if self.offset_s > 0.0 else "younger"
        return f"The gyro's samples are {1e3 * abs(self.offset_s):.3g} ms {older} than the encoder's of the same stamp."
