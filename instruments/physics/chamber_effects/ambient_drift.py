"""Chamber effect: drift of the room temperature."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect, ChamberSignals, ChamberStage
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class AmbientDrift(ChamberEffect):
    """A room temperature that is linear in time."""

    c_per_hour: float

    identifier: ClassVar[str] = "ambient_drift"
    stage: ClassVar[ChamberStage] = "loss"
    words: ClassVar[str] = (
        "What the chamber loses its heat to becomes warmer or colder in the course of a run: the room, the "
        "casing, a heat sink."
    )
    equation: ClassVar[str] = "T_room → T_room + drift·t/3600"
    coordinate: ClassVar[str] = "time"
    excited_by: ClassVar[str] = "long holds"
    look_alikes: ClassVar[tuple[str, ...]] = ("heat_store", "loss_step")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "c_per_hour": Parameter(
            unit="degC h-1",
            meaning="warming of the room in an hour",
            low=-1e4,
            high=1e4,
            role="size",
            scan=(1e-2,),
            zero=0.0,
        ),
    }

    def apply(self, signals: ChamberSignals) -> ChamberSignals:
        """Return the run in a drifting room."""
        return replace(signals, room_c=signals.room_c + self.c_per_hour * signals.time_s / 3600.0)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"What the chamber loses its heat to changes by {self.c_per_hour:.3g} K an hour: the room, the casing or a"
            " heat sink."
        )
