"""Effect: fringe ambiguity of the interferometer above some rate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


def folded_dps(rate_dps: FloatArray, fold_dps: float) -> FloatArray:
    """Return rates of shape (n,), folded back at ±fold_dps as often as necessary."""
    folded = rate_dps + fold_dps
    np.mod(folded, 4.0 * fold_dps, out=folded)
    folded -= 2.0 * fold_dps
    np.abs(folded, out=folded)
    np.subtract(fold_dps, folded, out=folded)
    return folded


@dataclass(frozen=True, slots=True, kw_only=True)
class FringeAmbiguity(PhysicalEffect):
    """The rate folds back at ±fold_dps as often as necessary (domain facts, FOLD): a triangle wave of the true rate."""

    fold_dps: float

    identifier: ClassVar[str] = "fringe_ambiguity"
    stage: ClassVar[Stage] = "sensed_rate"
    pointwise: ClassVar[bool] = True
    momentary: ClassVar[bool] = True
    words: ClassVar[str] = (
        "Beyond a certain rate the output falls again as the rate grows: the interferometer has passed the top of its"
        " fringe, and two rates give the same volts."
    )
    equation: ClassVar[str] = "ω → fold − |(ω + fold) mod 4·fold − 2·fold|"
    coordinate: ClassVar[str] = "rate"
    excited_by: ClassVar[str] = "rates at the end of the range and beyond"
    look_alikes: ClassVar[tuple[str, ...]] = ("overload", "saturation", "two_rails", "rate_nonlinearity")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "fold_dps": Parameter(
            unit="degree/s",
            meaning="the rate at which the output turns back",
            low=1.0,
            high=5000.0,
            role="shape",
            scan=(20.0, 55.0, 115.0, 200.0),
            zero=math.inf,
            logarithmic=True,
            by_scan=True,
        )
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the signals with the folded rate."""
        rate = signals.sensed_rate_dps
        if max(rate.max(), -rate.min()) <= self.fold_dps:
            return signals
        return replace(signals, sensed_rate_dps=folded_dps(rate, self.fold_dps))

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"Beyond {self.fold_dps:.4g} °/s the output turns back: the interferometer has passed the top of its"
            " fringe, and two rates give the same volts."
        )
