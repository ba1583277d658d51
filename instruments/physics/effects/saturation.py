"""Effect: saturation of the output."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class Saturation(PhysicalEffect):
    """|U| is clipped at a limit, below the rated one (domain facts, SAT)."""

    limit_v: float

    identifier: ClassVar[str] = "saturation"
    stage: ClassVar[Stage] = "electronics"
    pointwise: ClassVar[bool] = True
    momentary: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The output stops at a limit that it should not have yet: an amplifier or a converter runs into its rail. Up to"
        " there everything is right."
    )
    equation: ClassVar[str] = "U → min(max(U, −limit), limit)"
    coordinate: ClassVar[str] = "output"
    excited_by: ClassVar[str] = "rates near the end of the range"
    look_alikes: ClassVar[tuple[str, ...]] = ("two_rails", "overload", "fringe_ambiguity", "rate_nonlinearity")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "limit_v": Parameter(
            unit="V",
            meaning="the largest output, in both directions",
            low=1e-3,
            high=100.0,
            role="shape",
            scan=(0.25, 0.5, 1.0, 2.0, 4.0, 8.0),
            zero=math.inf,
            logarithmic=True,
            by_scan=True,
        )
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the clipped output."""
        return replace(signals, output_v=np.clip(signals.output_v, -self.limit_v, self.limit_v))

    def says(self) -> str:
        """Return the finding in one sentence."""
        return f"The output is clipped at ±{self.limit_v:.4g} V, below its rated limit."
