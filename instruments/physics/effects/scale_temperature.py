"""Effect: temperature dependence of the scale factor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaleTemperature(PhysicalEffect):
    """k(T) is missing: the scale factor is × (1 + a1·(T−T0) + a2·(T−T0)²) (domain facts, KT)."""

    a1: float
    a2: float
    T0_c: float = 20.0

    identifier: ClassVar[str] = "scale_temperature"
    stage: ClassVar[Stage] = "scale"
    pointwise: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The scale factor depends on the temperature: the source's power and wavelength, the modulator and the coil"
        " all change with it. The same rate gives other volts in the cold than in the heat."
    )
    equation: ClassVar[str] = "U − U0 → (U − U0)·(1 + a1·(T−T0) + a2·(T−T0)²)"
    coordinate: ClassVar[str] = "rate*gyro_temp"
    excited_by: ClassVar[str] = "rotation at three temperatures or more"
    look_alikes: ClassVar[tuple[str, ...]] = (
        "scale_rate_temperature_coupling",
        "thermal_hysteresis",
        "scale_warm_up",
        "supply_sensitivity",
    )
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "a1": Parameter(
            unit="degC-1",
            meaning="relative change of the scale factor a degree, at T0",
            low=-1e-2,
            high=1e-2,
            role="size",
            scan=(1e-6,),
            zero=0.0,
        ),
        "a2": Parameter(
            unit="degC-2",
            meaning="its curvature",
            low=-1e-4,
            high=1e-4,
            role="size",
            scan=(1e-8,),
            zero=0.0,
        ),
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with a scale factor that depends on the coil's temperature."""
        delta_c = signals.coil_c - self.T0_c
        volts = self.a2 * delta_c
        volts += self.a1
        volts *= delta_c
        volts += 1.0
        volts *= signals.output_v
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The scale factor depends on the temperature: by {1e6 * self.a1:+.3g} ppm a degree at {self.T0_c:.3g} °C,"
            f" and that slope itself changes by {2e6 * self.a2:+.3g} ppm a degree with every degree."
        )
