"""Single samples that have nothing to do with the gyro."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import scipy  # which loads special when it is first used

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.draws import normals
from benchctl_instruments.physics.effects.effect import Parameter
from benchctl_instruments.physics.effects.kinds import NoiseEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class Outliers(NoiseEffect):
    """A fraction of the samples is off by normal errors of standard deviation scale (domain facts, SPIKE).

    Which samples are hit is chance, each independently of the others.
    """

    fraction: float
    scale_v: float
    seed: int = 1

    identifier: ClassVar[str] = "outliers"
    stage: ClassVar[Stage] = "sampling"
    words: ClassVar[str] = (
        "Now and then a single sample is far off, up or down: a spike on the line or a bit that was read wrongly. Its"
        " neighbours are right."
    )
    equation: ClassVar[str] = "U → U + s·n, n ~ N(0, scale²), s = 1 for a fraction of the samples, else 0"
    coordinate: ClassVar[str] = "time"
    excited_by: ClassVar[str] = "nothing: they come at any time"
    look_alikes: ClassVar[tuple[str, ...]] = ("dropouts", "noise_rate_dependent")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "fraction": Parameter(
            unit="1",
            meaning="share of the samples that are hit",
            low=1e-7,
            high=0.5,
            role="shape",
            scan=(1e-5, 1e-4, 1e-3, 1e-2),
            zero=0.0,
            logarithmic=True,
        ),
        "scale_v": Parameter(
            unit="V",
            meaning="standard deviation of the spikes",
            low=0.0,
            high=100.0,
            role="size",
            scan=(1e-3,),
            zero=0.0,
        ),
    }

    def apply(self, signals: Signals) -> Signals:
        """The output with spikes."""
        chance = normals(self.seed, self.identifier, signals.first_index, signals.time_s.size, 2)
        hit = chance[:, 0] < scipy.special.ndtri(self.fraction)
        volts = signals.output_v.copy()
        volts[hit] += self.scale_v * chance[hit, 1]
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """The finding in one sentence."""
        return (
            f"One sample in {1.0 / self.fraction if self.fraction else float('inf'):.3g} is a spike of"
            f" {1e3 * self.scale_v:.3g} mV (standard deviation) that has nothing to do with the gyro."
        )
