"""Effect: different scale factors in the two directions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaleAsymmetry(PhysicalEffect):
    """The scale factor is × (1 + ½·fraction·sign ω), fraction = (S₊−S₋)/S (domain facts, ASYM)."""

    fraction: float

    identifier: ClassVar[str] = "scale_asymmetry"
    stage: ClassVar[Stage] = "scale"
    pointwise: ClassVar[bool] = True
    momentary: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The scale factor is larger in one direction than in the other: the characteristic has a kink at zero rate."
    )
    equation: ClassVar[str] = "U − U0 → (U − U0)·(1 + ½·fraction·sign ω)"
    coordinate: ClassVar[str] = "abs_rate"
    excited_by: ClassVar[str] = "both directions, at three rates or more"
    look_alikes: ClassVar[tuple[str, ...]] = ("rate_squared",)
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "fraction": Parameter(
            unit="1",
            meaning="difference of the scale factors of the two directions, over their mean",
            low=-0.2,
            high=0.2,
            role="size",
            scan=(1e-5,),
            zero=0.0,
        )
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with a direction-dependent scale factor; unchanged at rest."""
        volts = np.sign(signals.sensed_rate_dps)
        volts *= 0.5 * self.fraction
        volts += 1.0
        volts *= signals.output_v
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The scale factor is {100.0 * abs(self.fraction):.3g} % larger"
            f" {'counter-clockwise' if self.fraction > 0.0 else 'clockwise'} than the other way round."
        )
