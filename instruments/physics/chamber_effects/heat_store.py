"""Chamber effect: a body inside stores heat."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect, ChamberSignals, ChamberStage
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class HeatStore(ChamberEffect):
    """A wall or load that exchanges heat only with the air."""

    capacity: float
    tau_s: float

    identifier: ClassVar[str] = "heat_store"
    stage: ClassVar[ChamberStage] = "loss"
    words: ClassVar[str] = (
        "Walls, racks or a load take up heat from the air and give it back: after a change the air first moves "
        "fast, then creeps."
    )
    equation: ClassVar[str] = "dT/dt = … − capacity·dT_store/dt; τ_store·dT_store/dt = T − T_store"
    coordinate: ClassVar[str] = "time"
    excited_by: ClassVar[str] = "long holds after a change"
    look_alikes: ClassVar[tuple[str, ...]] = ("second_lag", "radiation", "ambient_drift")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "capacity": Parameter(
            unit="1",
            meaning="its heat capacity, relative to that of the air",
            low=0.0,
            high=100.0,
            role="size",
            scan=(1e-3,),
            zero=0.0,
        ),
        "tau_s": Parameter(
            unit="s",
            meaning="its time constant",
            low=0.5,
            high=1e5,
            role="shape",
            scan=(5.0, 15.0, 40.0, 100.0, 250.0, 600.0, 1500.0),
            logarithmic=True,
        ),
    }

    def apply(self, signals: ChamberSignals) -> ChamberSignals:
        """Return the run with another body, which starts at the air's temperature."""
        return replace(signals, stores=(*signals.stores, (self.capacity, self.tau_s)))

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"A body inside takes up heat with a time constant of {self.tau_s:.3g} s, {self.capacity:.3g} times as"
            " much for each kelvin as the air itself: the air first moves fast, then creeps."
        )
