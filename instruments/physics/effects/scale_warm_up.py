"""Effect: warm-up of the scale factor after the start of the recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect
from benchctl_instruments.physics.effects.settling import SETTLING_TIME, left


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaleWarmUp(PhysicalEffect):
    """The scale factor is × (1 + fraction·e^(−t/tau)) (domain facts, WARM); t counts from `start_s`."""

    fraction: float
    tau_s: float
    start_s: float = 0.0

    identifier: ClassVar[str] = "scale_warm_up"
    stage: ClassVar[Stage] = "scale"
    pointwise: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The gyro was not yet warm when the recording began: its scale factor comes to its final value as an"
        " exponential in time, whatever the chamber does."
    )
    equation: ClassVar[str] = "U − U0 → (U − U0)·(1 + fraction·e^(−t/tau))"
    coordinate: ClassVar[str] = "rate*time"
    excited_by: ClassVar[str] = "rotation from the first minutes on, and again long after"
    look_alikes: ClassVar[tuple[str, ...]] = ("scale_ageing", "thermal_lag", "scale_temperature", "thermal_hysteresis")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "fraction": Parameter(
            unit="1",
            meaning="relative error of the scale factor when the recording begins",
            low=-0.5,
            high=0.5,
            role="size",
            scan=(1e-5,),
            zero=0.0,
        ),
        "tau_s": SETTLING_TIME,
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with a settling scale factor."""
        volts = left(signals.time_s, self.start_s, self.tau_s)
        volts *= self.fraction
        volts += 1.0
        volts *= signals.output_v
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The scale factor begins {100.0 * abs(self.fraction):.3g} %"
            f" {'low' if self.fraction < 0.0 else 'high'} and settles with a time constant of {self.tau_s:.3g} s,"
            " at any temperature: the gyro was warming up."
        )
