"""Effect: gyro and encoder are stamped by two clocks with different speeds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Stage
from benchctl_instruments.physics.effects.effect import Parameter
from benchctl_instruments.physics.effects.kinds import ClockEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockDrift(ClockEffect):
    """At stamp t the gyro is sampled at t·(1 + ppm·10⁻⁶), the encoder at t (domain facts, CLK).

    t counts from `start_s`.
    """

    ppm: float
    start_s: float = 0.0

    identifier: ClassVar[str] = "clock_drift"
    stage: ClassVar[Stage] = "sampling"
    words: ClassVar[str] = (
        "Encoder and gyro were stamped by two clocks that do not run alike: in step when the recording begins, they are"
        " further apart the longer it lasts."
    )
    equation: ClassVar[str] = "U(t) → U(t·(1 + ppm·10⁻⁶))"
    coordinate: ClassVar[str] = "acceleration*time"
    excited_by: ClassVar[str] = "reversals and oscillations, both early and late"
    look_alikes: ClassVar[tuple[str, ...]] = ("timing_offset",)
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "ppm": Parameter(
            unit="1e-6",
            meaning="by how much the gyro's clock is faster",
            low=-2000.0,
            high=2000.0,
            role="size",
            scan=(0.1,),
            zero=0.0,
        )
    }

    def gyro_time_s(self, stamp_s: FloatArray) -> FloatArray:
        """Return the sampling instants [s] of the gyro."""
        instants = stamp_s - self.start_s
        instants *= 1e-6 * self.ppm
        instants += stamp_s
        return instants

    def says(self) -> str:
        """Return the finding in one sentence."""
        ahead = "ahead of" if self.ppm > 0.0 else "behind"
        return (
            f"The gyro's samples get {1e-3 * 3600.0 * abs(self.ppm):.3g} ms an hour further {ahead} the encoder's:"
            f" their clocks differ by {abs(self.ppm):.3g} ppm."
        )
