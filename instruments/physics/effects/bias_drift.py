"""Effect: bias drift in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasDrift(PhysicalEffect):
    """U + v·t/3600 (domain facts, RAMP); t counts from `start_s`."""

    v_per_hour: float
    start_s: float = 0.0

    identifier: ClassVar[str] = "bias_drift"
    stage: ClassVar[Stage] = "bias"
    pointwise: ClassVar[bool] = True
    words: ClassVar[str] = "The bias runs away at a steady pace, at any temperature and any rate: a line in time."
    equation: ClassVar[str] = "U → U + v·t/3600"
    coordinate: ClassVar[str] = "time"
    excited_by: ClassVar[str] = "rest early and late at the same temperature"
    look_alikes: ClassVar[tuple[str, ...]] = ("warm_up", "bias_random_walk", "bias_temperature")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "v_per_hour": Parameter(
            unit="V h-1",
            meaning="change of the bias in an hour",
            low=-10.0,
            high=10.0,
            role="size",
            scan=(1e-6,),
            zero=0.0,
        )
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with a bias that changes with time."""
        volts = signals.time_s - self.start_s
        volts *= self.v_per_hour / 3600.0
        volts += signals.output_v
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The bias {'falls' if self.v_per_hour < 0.0 else 'rises'} by {1e3 * abs(self.v_per_hour):.3g} mV an hour,"
            " at any temperature."
        )
