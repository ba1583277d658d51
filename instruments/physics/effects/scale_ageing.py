"""Effect: drift of the scale factor in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaleAgeing(PhysicalEffect):
    """The scale factor is × (1 + per_hour·t/3600) (domain facts, AGE); t counts from `start_s`."""

    per_hour: float
    start_s: float = 0.0

    identifier: ClassVar[str] = "scale_ageing"
    stage: ClassVar[Stage] = "scale"
    pointwise: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The scale factor changes steadily with time at any temperature: the light source loses power, or a gain"
        " drifts."
    )
    equation: ClassVar[str] = "U − U0 → (U − U0)·(1 + per_hour·t/3600)"
    coordinate: ClassVar[str] = "rate*time"
    excited_by: ClassVar[str] = "the same rates early and late at the same temperature"
    look_alikes: ClassVar[tuple[str, ...]] = ("scale_warm_up", "scale_temperature", "supply_sensitivity")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "per_hour": Parameter(
            unit="h-1",
            meaning="relative change of the scale factor in an hour",
            low=-0.5,
            high=0.5,
            role="size",
            scan=(1e-5,),
            zero=0.0,
        )
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with a scale factor that changes with time."""
        volts = signals.time_s - self.start_s
        volts *= self.per_hour / 3600.0
        volts += 1.0
        volts *= signals.output_v
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The scale factor {'falls' if self.per_hour < 0.0 else 'rises'} by {100.0 * abs(self.per_hour):.3g} %"
            " an hour, at any temperature."
        )
