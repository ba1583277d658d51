"""Chamber effect: a limited ramp of the set point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect, ChamberSignals, ChamberStage, Drive
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class RampLimit(ChamberEffect):
    """The set point is followed at a limited slope."""

    c_per_min: float

    identifier: ClassVar[str] = "ramp_limit"
    stage: ClassVar[ChamberStage] = "source"
    drives: ClassVar[tuple[Drive, ...]] = ("setpoint",)
    words: ClassVar[str] = (
        "The controller does not let the air follow a step of its set point at once: it leads it there at a "
        "limited slope."
    )
    equation: ClassVar[str] = "|dT_set/dt| ≤ limit"
    coordinate: ClassVar[str] = "chamber_temp_rate"
    excited_by: ClassVar[str] = "large steps of the set point"
    look_alikes: ClassVar[tuple[str, ...]] = ("dead_time", "second_lag")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "c_per_min": Parameter(
            unit="degC min-1",
            meaning="steepest slope",
            low=0.01,
            high=1e3,
            role="shape",
            scan=(0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0),
            logarithmic=True,
        ),
    }

    def apply(self, signals: ChamberSignals) -> ChamberSignals:
        """Return the run with the ramped set point."""
        most = self.c_per_min / 60.0 * signals.interval_s
        led = signals.drive.copy()
        for i in range(1, led.size):
            led[i] = led[i - 1] + min(max(signals.drive[i] - led[i - 1], -most), most)
        return replace(signals, drive=led)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return f"The controller limits the ramp of its set point to {self.c_per_min:.3g} K/min."
