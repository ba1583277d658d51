"""Effect: single samples that are unrelated to the gyro."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import scipy  # scipy.special is loaded on first use

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.draws import normals
from benchctl_instruments.physics.effects.effect import Parameter
from benchctl_instruments.physics.effects.kinds import NoiseEffect

NORMAL, EXPONENTIAL = 2.0, 1.0
"""Exponents of the tails."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outliers(NoiseEffect):
    """A fraction of the samples has errors (domain facts, SPIKE), normal or with exponential tails.

    The affected samples are random and independent of each other.
    """

    fraction: float
    scale_v: float
    tail_exponent: float = NORMAL
    seed: int = 1

    identifier: ClassVar[str] = "outliers"
    stage: ClassVar[Stage] = "sampling"
    words: ClassVar[str] = (
        "Now and then a single sample is far off, up or down: a spike on the line or a bit that was read wrongly. Its"
        " neighbours are right."
    )
    equation: ClassVar[str] = (
        "U → U + s·x, density of x ∝ exp(−|x/scale|^p/p) with p = 2 (normal) or 1 (Laplace), s = 1 for a fraction of"
        " the samples, else 0"
    )
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
            meaning="scale of the spikes: of normal ones the standard deviation, of Laplace's the mean size",
            low=0.0,
            high=100.0,
            role="size",
            scan=(1e-3,),
            zero=0.0,
        ),
        "tail_exponent": Parameter(
            unit="1",
            meaning="exponent of the tails: 2 of normal spikes, 1 of Laplace's",
            low=EXPONENTIAL,
            high=NORMAL,
            role="choice",
            scan=(NORMAL, EXPONENTIAL),
        ),
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with spikes."""
        chance = normals(self.seed, self.identifier, signals.first_index, signals.time_s.size, 2)
        hit = chance[:, 0] < scipy.special.ndtri(self.fraction)
        volts = signals.output_v.copy()
        volts[hit] += self.scale_v * (chance[hit, 1] if self.tail_exponent == NORMAL else _laplace(chance[hit, 1]))
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        size = "standard deviation" if self.tail_exponent == NORMAL else "mean size; few are many times as large"
        return (
            f"One sample in {1.0 / self.fraction if self.fraction else float('inf'):.3g} is a spike of"
            f" {1e3 * self.scale_v:.3g} mV ({size}) that has nothing to do with the gyro."
        )


def _laplace(normal: FloatArray) -> FloatArray:
    """Transform normal numbers, shape (n,), to the same quantiles of Laplace's distribution of scale 1."""
    tail: FloatArray = scipy.special.log_ndtr(-np.abs(normal)) + math.log(2.0)
    return -np.sign(normal) * tail
