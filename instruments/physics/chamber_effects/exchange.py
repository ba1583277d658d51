"""Chamber effect: heat exchange with a second body whose temperature was measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect, ChamberSignals, ChamberStage
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchange(ChamberEffect):
    """Heat flows between the air and a body with its own measured temperature."""

    rate_per_s: float

    identifier: ClassVar[str] = "exchange"
    stage: ClassVar[ChamberStage] = "loss"
    needs_second: ClassVar[bool] = True
    words: ClassVar[str] = (
        "Heat flows between the air and a second body whose temperature was measured, a load, a heat sink or the"
        " neighbouring zone: in proportion to the difference of the two temperatures."
    )
    equation: ClassVar[str] = "dT/dt = … − rate·(T − T_second)"
    coordinate: ClassVar[str] = "time"
    excited_by: ClassVar[str] = "a second temperature that moves apart from the air"
    look_alikes: ClassVar[tuple[str, ...]] = ("heat_store", "ambient_drift", "loss_step")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "rate_per_s": Parameter(
            unit="s-1",
            meaning="share of the difference that is made up for in a second",
            low=0.0,
            high=10.0,
            role="size",
            scan=(1e-5,),
            zero=0.0,
        ),
    }

    def apply(self, signals: ChamberSignals) -> ChamberSignals:
        """Return the run with the second body, unchanged if its temperature was not measured."""
        return signals if signals.second_c is None else replace(signals, exchange=signals.exchange + self.rate_per_s)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            "Heat is exchanged with the second body: by it alone the air would follow with a time constant of"
            f" {1.0 / max(self.rate_per_s, 1e-9):.3g} s."
        )
