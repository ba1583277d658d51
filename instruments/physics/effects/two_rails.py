"""Effect: saturation of the output at two limits of different magnitude."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class TwoRails(PhysicalEffect):
    """U is clipped at two independent limits (domain facts, SAT: clip(U, U₋, U₊)), which need not include 0 V."""

    lower_v: float
    upper_v: float

    identifier: ClassVar[str] = "two_rails"
    stage: ClassVar[Stage] = "electronics"
    pointwise: ClassVar[bool] = True
    momentary: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The output stops at a lower and at an upper limit that are not of one size, as that of an amplifier on a"
        " single supply does. Between them everything is right."
    )
    equation: ClassVar[str] = "U → min(max(U, lower), upper)"
    coordinate: ClassVar[str] = "output"
    excited_by: ClassVar[str] = "rates near the end of the range, in both directions"
    look_alikes: ClassVar[tuple[str, ...]] = ("saturation", "overload", "fringe_ambiguity", "rate_nonlinearity")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "lower_v": Parameter(
            unit="V",
            meaning="the smallest output",
            low=-100.0,
            high=100.0,
            role="shape",
            scan=(-8.0, -2.0, 0.1),
            zero=-math.inf,
            by_scan=True,
        ),
        "upper_v": Parameter(
            unit="V",
            meaning="the largest output",
            low=-100.0,
            high=100.0,
            role="shape",
            scan=(0.5, 2.5, 5.0),
            zero=math.inf,
            by_scan=True,
        ),
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the clipped output."""
        return replace(signals, output_v=np.clip(signals.output_v, self.lower_v, self.upper_v))

    def says(self) -> str:
        """Return the finding in one sentence."""
        return f"The output is clipped between two rails, {self.lower_v:.4g} V and {self.upper_v:.4g} V."
