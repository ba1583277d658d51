"""Chamber effect: a second thermal lag."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import scipy  # scipy.signal is loaded on first use

from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect, ChamberSignals, ChamberStage
from benchctl_instruments.physics.effects.effect import Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class SecondLag(ChamberEffect):
    """A first-order lag between drive and air: the heater, or the sensor, must warm up itself."""

    tau_s: float

    identifier: ClassVar[str] = "second_lag"
    stage: ClassVar[ChamberStage] = "transport"
    words: ClassVar[str] = (
        "The heat reaches the thermometer through a second body with its own time constant: the heater "
        "element must warm up before it heats the air, or the thermometer follows late."
    )
    equation: ClassVar[str] = "τ2·du2/dt = u − u2; u2 in place of u"
    coordinate: ClassVar[str] = "time"
    excited_by: ClassVar[str] = "sudden changes of power or set point"
    look_alikes: ClassVar[tuple[str, ...]] = ("dead_time", "heat_store")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "tau_s": Parameter(
            unit="s",
            meaning="second time constant",
            low=0.05,
            high=1e5,
            role="shape",
            scan=(5.0, 15.0, 40.0, 100.0, 250.0, 600.0, 1500.0),
            zero=0.0,
            logarithmic=True,
        ),
    }

    def apply(self, signals: ChamberSignals) -> ChamberSignals:
        """Return the run with the lagged drive, averaged from sample to sample for a held input."""
        if self.tau_s <= 0.0:
            return signals
        pole = math.exp(-signals.interval_s / self.tau_s)
        at_samples, _ = scipy.signal.lfilter([0.0, 1.0 - pole], [1.0, -pole], signals.drive, zi=[signals.drive_before])
        behind = (1.0 - pole) * self.tau_s / signals.interval_s
        return replace(signals, drive=np.asarray(signals.drive + behind * (at_samples - signals.drive)))

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The heat reaches the thermometer through a second lag of {self.tau_s:.3g} s: heater or thermometer must"
            " warm up themselves."
        )
