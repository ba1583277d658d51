"""Chamber effect: radiation of hot walls."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect, ChamberSignals, ChamberStage, Drive
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Radiation(ChamberEffect):
    """A part of the loss grows with the fourth power of the absolute temperature."""

    share: float

    identifier: ClassVar[str] = "radiation"
    stage: ClassVar[ChamberStage] = "loss"
    drives: ClassVar[tuple[Drive, ...]] = ("power",)
    words: ClassVar[str] = (
        "A part of the heat is radiated: the loss grows faster than the temperature, with its fourth power."
    )
    equation: ClassVar[str] = "T − T_room → (1 − share)·(T − T_room) + share·(T⁴ − T_room⁴)/(4·300³), T in kelvin"
    coordinate: ClassVar[str] = "chamber_temp"
    excited_by: ClassVar[str] = "holds at three or more temperatures"
    look_alikes: ClassVar[tuple[str, ...]] = ("heater_nonlinearity", "loss_step")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "share": Parameter(
            unit="1",
            meaning="radiated part of the loss at 300 K",
            low=0.0,
            high=1.0,
            role="size",
            scan=(1e-3,),
            zero=0.0,
        ),
    }

    def apply(self, signals: ChamberSignals) -> ChamberSignals:
        """Return the run with radiation."""
        return replace(signals, loss=signals.loss * (1.0 - self.share), radiation=signals.radiation + self.share)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return f"Heat is radiated: {100.0 * self.share:.3g} % of what is lost at 300 K, and more the hotter it is."
