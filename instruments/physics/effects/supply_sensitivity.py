"""Effect: dependence of scale factor and bias on the supply voltage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class SupplySensitivity(PhysicalEffect):
    """U → U·(1 + fraction·ΔV) + v·ΔV (domain facts, PSU), of the output before its bias.

    ΔV is the change of the supply [V] since the first sample, to which the scale factor and the bias refer. The supply
    is the first auxiliary channel whose name begins with `supply`; without one the output does not change.
    """

    fraction_per_v: float
    v_per_v: float

    identifier: ClassVar[str] = "supply_sensitivity"
    stage: ClassVar[Stage] = "scale"
    timeless: ClassVar[bool] = True
    words: ClassVar[str] = (
        "Scale factor and bias follow the supply voltage: what should be stabilised, or divided by the supply, is not."
    )
    equation: ClassVar[str] = "U − U0 → (U − U0)·(1 + fraction·(V−V(0))) + v·(V−V(0))"
    coordinate: ClassVar[str] = "time"
    excited_by: ClassVar[str] = "a supply that changes, at rest and in rotation"
    look_alikes: ClassVar[tuple[str, ...]] = ("scale_ageing", "scale_temperature", "bias_drift", "bias_random_walk")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "fraction_per_v": Parameter(
            unit="V-1",
            meaning="relative change of the scale factor a volt of the supply",
            low=-2.0,
            high=2.0,
            role="size",
            scan=(1e-5,),
            zero=0.0,
        ),
        "v_per_v": Parameter(
            unit="1",
            meaning="change of the bias a volt of the supply",
            low=-2.0,
            high=2.0,
            role="size",
            scan=(1e-6,),
            zero=0.0,
        ),
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with the dependence on the supply."""
        channel = next((name for name in signals.auxiliary if name.startswith("supply")), None)
        if channel is None:
            return signals
        supply_v = signals.auxiliary[channel]
        first = signals.memory.get(self.identifier, supply_v[:1])
        change = supply_v - first[0]
        volts = self.fraction_per_v * change
        volts += 1.0
        volts *= signals.output_v
        change *= self.v_per_v
        volts += change
        return replace(signals, output_v=volts, memory={**signals.memory, self.identifier: first})

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"A volt of the supply changes the scale factor by {100.0 * self.fraction_per_v:+.3g} %"
            f" and the bias by {1e3 * self.v_per_v:+.3g} mV."
        )
