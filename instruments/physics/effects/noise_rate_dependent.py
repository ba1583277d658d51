"""Effect: noise that grows with the rate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.draws import normals
from benchctl_instruments.physics.effects.effect import Parameter
from benchctl_instruments.physics.effects.kinds import NoiseEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseRateDependent(NoiseEffect):
    """White noise of deviation σ·√(1 + (factor² − 1)·(ω/range)²) (domain facts, SLIP).

    σ is `noise_v_rms`, the deviation of a streamed sample at rest. The bench already includes this noise: the effect
    adds the remaining part, independent of it. ω is the table's rate, `range_dps` the rated one.
    """

    factor_at_full_rate: float
    range_dps: float = 175.0
    noise_v_rms: float = 5e-4
    seed: int = 1

    identifier: ClassVar[str] = "noise_rate_dependent"
    stage: ClassVar[Stage] = "sampling"
    words: ClassVar[str] = (
        "The output is noisier in motion than at rest: slip rings, cables and the light's own noise add white noise"
        " that grows with the rate in either direction."
    )
    equation: ClassVar[str] = "σ(ω) = σ·√(1 + (factor² − 1)·(ω/range)²)"
    coordinate: ClassVar[str] = "abs_rate"
    excited_by: ClassVar[str] = "constant rates up to the full range, and rest"
    look_alikes: ClassVar[tuple[str, ...]] = ("outliers", "encoder_interpolation")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "factor_at_full_rate": Parameter(
            unit="1",
            meaning="noise at the rated range over noise at rest",
            low=1.0,
            high=100.0,
            role="shape",
            scan=(1.2, 1.5, 2.0, 3.0, 5.0, 10.0),
            zero=1.0,
            logarithmic=True,
        )
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with the rate-dependent noise."""
        volts = normals(self.seed, self.identifier, signals.first_index, signals.time_s.size, 1)[:, 0]
        volts *= np.abs(signals.rate_dps)
        volts *= self.noise_v_rms * math.sqrt(self.factor_at_full_rate**2 - 1.0) / self.range_dps
        volts += signals.output_v
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return f"The noise grows with the rate: at full range it is {self.factor_at_full_rate:.3g} times that at rest."
