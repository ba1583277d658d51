"""Effect: coupling of rate and temperature in the scale factor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaleRateTemperatureCoupling(PhysicalEffect):
    """k(T, ω) is not separable: the scale factor is × (1 + coefficient·(T−T0)·ω²) (domain facts, KTW).

    The interferometer's S, which determines the curvature of its sine, changes with temperature: the coefficient is
    −(S²/3)·(1/S)·dS/dT.
    """

    coefficient: float
    T0_c: float = 20.0
    range_dps: float = 200.0

    identifier: ClassVar[str] = "scale_rate_temperature_coupling"
    stage: ClassVar[Stage] = "scale"
    pointwise: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The curvature of the characteristic changes with temperature, so that k(T, ω) is not a product k(T)·k(ω):"
        " each is right alone, but at high rates in the heat or in the cold the product is not."
    )
    equation: ClassVar[str] = "U − U0 → (U − U0)·(1 + coefficient·(T−T0)·ω²)"
    coordinate: ClassVar[str] = "rate*gyro_temp"
    excited_by: ClassVar[str] = "high rates at the ends of the temperature range"
    look_alikes: ClassVar[tuple[str, ...]] = ("scale_temperature", "rate_nonlinearity")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "coefficient": Parameter(
            unit="degC-1 (degree/s)-2",
            meaning="relative change of the scale factor a degree and a square of the rate",
            low=-1e-6,
            high=1e-6,
            role="size",
            scan=(1e-11,),
            zero=0.0,
        )
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with a scale factor whose curvature depends on the coil's temperature."""
        volts = signals.coil_c - self.T0_c
        volts *= self.coefficient
        volts *= signals.sensed_rate_dps
        volts *= signals.sensed_rate_dps
        volts += 1.0
        volts *= signals.output_v
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        change = self.coefficient * 10.0 * self.range_dps**2
        return (
            "The curvature of the characteristic changes with temperature: ten degrees above"
            f" {self.T0_c:.3g} °C the scale factor at {self.range_dps:.4g} °/s is {100.0 * abs(change):.3g} %"
            f" {'lower' if change < 0.0 else 'higher'} than by k(T)·k(ω)."
        )
