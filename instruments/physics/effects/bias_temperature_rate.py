"""Effect: dependence of the bias on the rate of temperature change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasTemperatureRate(PhysicalEffect):
    """U + v·dT/dt (domain facts, SHUPE)."""

    v_per_c_per_s: float

    identifier: ClassVar[str] = "bias_temperature_rate"
    stage: ClassVar[Stage] = "bias"
    pointwise: ClassVar[bool] = True
    words: ClassVar[str] = (
        "While the temperature changes the bias is shifted, one way in heating and the other in cooling, and it comes"
        " back as soon as the temperature is constant: the two ends of the coil warm unequally (Shupe's effect)."
    )
    equation: ClassVar[str] = "U → U + v·dT/dt"
    coordinate: ClassVar[str] = "gyro_temp_rate"
    excited_by: ClassVar[str] = "rest while the temperature rises and falls at different speeds"
    look_alikes: ClassVar[tuple[str, ...]] = ("thermal_lag", "bias_temperature", "warm_up", "bias_random_walk")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "v_per_c_per_s": Parameter(
            unit="V s degC-1",
            meaning="bias for a change of one degree a second",
            low=-100.0,
            high=100.0,
            role="size",
            scan=(1e-4,),
            zero=0.0,
        )
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with the bias due to the coil's rate of temperature change."""
        volts = self.v_per_c_per_s * signals.coil_rate_c_per_s
        volts += signals.output_v
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            "The bias is shifted while the temperature changes, and only then:"
            f" by {1e3 * self.v_per_c_per_s / 60.0:+.3g} mV for one degree a minute."
        )
