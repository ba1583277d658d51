"""Effect: overload of the electronics above some rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class Overload(PhysicalEffect):
    """Above ±onset_dps each further degree per second reduces the output's magnitude by `loss_v_per_dps`.

    A loss above the scale factor makes the output fall again. The magnitude is that of U − U0, in both directions.
    """

    onset_dps: float
    loss_v_per_dps: float

    identifier: ClassVar[str] = "overload"
    stage: ClassVar[Stage] = "scale"
    pointwise: ClassVar[bool] = True
    momentary: ClassVar[bool] = True
    words: ClassVar[str] = (
        "Beyond a certain rate, above full scale as a rule, the electronics are overloaded: the output leaves its law"
        " and grows less than it should, or falls again. Up to there everything is right."
    )
    equation: ClassVar[str] = "|U − U0| → |U − U0| − loss·max(|ω| − onset, 0)"
    coordinate: ClassVar[str] = "abs_rate"
    excited_by: ClassVar[str] = "rates at the end of the range and beyond"
    look_alikes: ClassVar[tuple[str, ...]] = ("fringe_ambiguity", "saturation", "two_rails", "rate_nonlinearity")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "onset_dps": Parameter(
            unit="degree/s",
            meaning="the rate beyond which the output has left its law",
            low=1.0,
            high=5000.0,
            role="shape",
            scan=(20.0, 55.0, 115.0),
            logarithmic=True,
            by_scan=True,
        ),
        "loss_v_per_dps": Parameter(
            unit="V (degree/s)-1",
            meaning="what each further degree per second takes from the output's size",
            low=0.0,
            high=100.0,
            role="size",
            scan=(1e-5,),
            zero=0.0,
        ),
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output reduced by the loss; valid for a negative scale factor too."""
        rate = signals.sensed_rate_dps
        beyond = np.maximum(np.abs(rate) - self.onset_dps, 0.0)
        lost = self.loss_v_per_dps * beyond * np.sign(signals.output_v)
        return replace(signals, output_v=signals.output_v - lost)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"Beyond {self.onset_dps:.4g} °/s the gyro is overloaded: each further degree per second takes"
            f" {1e3 * self.loss_v_per_dps:.3g} mV from the output that its law gives."
        )
