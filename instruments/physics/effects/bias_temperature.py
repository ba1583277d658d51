"""Effect: temperature dependence of the bias."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasTemperature(PhysicalEffect):
    """U + c1·(T−T0) + c2·(T−T0)² (domain facts, BT)."""

    c1_v_per_c: float
    c2_v_per_c2: float
    T0_c: float = 20.0

    identifier: ClassVar[str] = "bias_temperature"
    stage: ClassVar[Stage] = "bias"
    pointwise: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The output at rest depends on the temperature, and comes back with it: the electronics and the optics shift."
    )
    equation: ClassVar[str] = "U → U + c1·(T−T0) + c2·(T−T0)²"
    coordinate: ClassVar[str] = "gyro_temp"
    excited_by: ClassVar[str] = "rest at three temperatures or more"
    look_alikes: ClassVar[tuple[str, ...]] = ("warm_up", "bias_drift", "bias_random_walk", "bias_temperature_rate")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "c1_v_per_c": Parameter(
            unit="V degC-1",
            meaning="change of the bias a degree, at T0",
            low=-0.1,
            high=0.1,
            role="size",
            scan=(1e-7,),
            zero=0.0,
        ),
        "c2_v_per_c2": Parameter(
            unit="V degC-2",
            meaning="its curvature",
            low=-1e-3,
            high=1e-3,
            role="size",
            scan=(1e-9,),
            zero=0.0,
        ),
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with the bias at the coil's temperature."""
        delta_c = signals.coil_c - self.T0_c
        volts = self.c2_v_per_c2 * delta_c
        volts += self.c1_v_per_c
        volts *= delta_c
        volts += signals.output_v
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The bias depends on the temperature: by {1e6 * self.c1_v_per_c:+.3g} µV a degree at {self.T0_c:.3g} °C,"
            f" and that slope itself changes by {2e6 * self.c2_v_per_c2:+.3g} µV a degree with every degree."
        )
