"""Chamber effect: a step of the heat loss at some moment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect, ChamberSignals, ChamberStage
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class LossStep(ChamberEffect):
    """A door is opened or a fan switched: before the moment the loss is × (1 + fraction) of the loss after it."""

    fraction: float
    moment: float
    duration_s: float = 1.0

    identifier: ClassVar[str] = "loss_step"
    stage: ClassVar[ChamberStage] = "loss"
    words: ClassVar[str] = (
        "From a certain moment on the air loses more or less heat than before, at the same temperature: a door "
        "was opened, a fan switched."
    )
    equation: ClassVar[str] = "loss → loss·(1 + fraction) for t < moment·duration"
    coordinate: ClassVar[str] = "time"
    excited_by: ClassVar[str] = "any long run"
    look_alikes: ClassVar[tuple[str, ...]] = ("radiation", "ambient_drift")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "fraction": Parameter(
            unit="1",
            meaning="how much more is lost before than after",
            low=-1.0,
            high=1e3,
            role="size",
            scan=(1e-3,),
            zero=0.0,
        ),
        "moment": Parameter(
            unit="1",
            meaning="when, as a share of the run",
            low=0.0,
            high=1.0,
            role="shape",
            scan=tuple(place / 40 for place in range(1, 40)),
        ),
    }

    def apply(self, signals: ChamberSignals) -> ChamberSignals:
        """Return the run with another loss before the moment, interpolated linearly within its sample."""
        since = (signals.time_s - self.moment * self.duration_s) / signals.interval_s
        return replace(signals, loss=signals.loss * (1.0 + self.fraction * np.clip(0.5 - since, 0.0, 1.0)))

    def says(self) -> str:
        """Return the finding in one sentence."""
        moment_s = self.moment * self.duration_s
        if self.fraction <= -0.95:
            return (
                f"The air loses hardly any heat until, {moment_s:.4g} s into the run, a loss begins: a door was opened,"
                " a fan switched on."
            )
        return (
            f"{moment_s:.4g} s into the run the loss of heat becomes {1.0 / (1.0 + self.fraction):.3g} times what it"
            " was: a door was opened or closed, a fan switched."
        )
