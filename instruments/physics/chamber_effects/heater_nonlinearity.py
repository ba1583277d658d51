"""Chamber effect: a nonlinear heater."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect, ChamberSignals, ChamberStage, Drive
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class HeaterNonlinearity(ChamberEffect):
    """Power × (1 + curvature·u/u_max): the heat is not proportional to the drive."""

    curvature: float
    largest_drive: float = 100.0

    identifier: ClassVar[str] = "heater_nonlinearity"
    stage: ClassVar[ChamberStage] = "source"
    drives: ClassVar[tuple[Drive, ...]] = ("power",)
    words: ClassVar[str] = (
        "The heat is not in proportion to the demanded power: a phase control without correction, a "
        "heater that changes its resistance, a pump of heat at its end."
    )
    equation: ClassVar[str] = "u → u·(1 + curvature·|u|/u_max)"
    coordinate: ClassVar[str] = "heater"
    excited_by: ClassVar[str] = "three or more levels of power"
    look_alikes: ClassVar[tuple[str, ...]] = ("radiation",)
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "curvature": Parameter(
            unit="1",
            meaning="by how much full power is more than in proportion",
            low=-1.0,
            high=10.0,
            role="size",
            scan=(1e-4,),
            zero=0.0,
            relative=True,
        ),
    }

    def apply(self, signals: ChamberSignals) -> ChamberSignals:
        """Return the run with the drive that the heater delivers."""
        return replace(
            signals, drive=signals.drive * (1.0 + self.curvature * np.abs(signals.drive) / self.largest_drive)
        )

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The heater is not proportional: at its largest drive it gives {100.0 * abs(self.curvature):.3g} %"
            f" {'more' if self.curvature > 0.0 else 'less'} than small drives promise."
        )
