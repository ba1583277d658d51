"""Effect: warm-up of the bias after the start of the recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect
from benchctl_instruments.physics.effects.settling import SETTLING_TIME, left


@dataclass(frozen=True, slots=True, kw_only=True)
class WarmUp(PhysicalEffect):
    """U + amplitude·e^(−t/tau) (domain facts, WARM); t counts from `start_s`."""

    amplitude_v: float
    tau_s: float
    start_s: float = 0.0

    identifier: ClassVar[str] = "warm_up"
    stage: ClassVar[Stage] = "bias"
    pointwise: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The gyro was not yet warm when the recording began: its bias comes to its final value as an exponential in"
        " time, whatever the chamber does."
    )
    equation: ClassVar[str] = "U → U + amplitude·e^(−t/tau)"
    coordinate: ClassVar[str] = "time"
    excited_by: ClassVar[str] = "rest from the first minutes on, and again long after"
    look_alikes: ClassVar[tuple[str, ...]] = (
        "bias_drift",
        "bias_random_walk",
        "bias_temperature",
        "bias_temperature_rate",
    )
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "amplitude_v": Parameter(
            unit="V",
            meaning="error of the bias when the recording begins",
            low=-10.0,
            high=10.0,
            role="size",
            scan=(1e-6,),
            zero=0.0,
        ),
        "tau_s": SETTLING_TIME,
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with a settling bias."""
        volts = left(signals.time_s, self.start_s, self.tau_s)
        volts *= self.amplitude_v
        volts += signals.output_v
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The bias begins {1e3 * abs(self.amplitude_v):.3g} mV too {'low' if self.amplitude_v < 0.0 else 'high'}"
            f" and settles with a time constant of {self.tau_s:.3g} s, at any temperature: the gyro was warming up."
        )
