"""Chamber effect: dead time of the heat."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect, ChamberSignals, ChamberStage
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class DeadTime(ChamberEffect):
    """u(t − delay): transport of the heat, or a slow controller."""

    delay_s: float

    identifier: ClassVar[str] = "dead_time"
    stage: ClassVar[ChamberStage] = "transport"
    words: ClassVar[str] = (
        "The air does not answer to its heater or set point for a while: the heat is on its way, or the "
        "controller acts now and then only."
    )
    equation: ClassVar[str] = "u(t) → u(t − delay)"
    coordinate: ClassVar[str] = "time"
    excited_by: ClassVar[str] = "sudden changes of power or set point"
    look_alikes: ClassVar[tuple[str, ...]] = ("second_lag",)
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "delay_s": Parameter(
            unit="s",
            meaning="time without an answer",
            low=0.0,
            high=1e5,
            role="shape",
            scan=(3.0, 10.0, 30.0, 100.0, 300.0),
            zero=0.0,
        ),
    }

    def apply(self, signals: ChamberSignals) -> ChamberSignals:
        """Return the run with the delayed drive."""
        # a drive is held from sample to sample, so its first value acts at the start itself
        time_s = np.concatenate([signals.time_s[:1] - signals.interval_s, signals.time_s])
        drive = np.concatenate([[signals.drive_before], signals.drive])
        return replace(signals, drive=np.interp(signals.time_s - self.delay_s, time_s, drive))

    def says(self) -> str:
        """Return the finding in one sentence."""
        return f"The air answers {self.delay_s:.3g} s late to its drive: a dead time."
