"""Effect: converter steps of unequal size."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class AdcNonlinearity(PhysicalEffect):
    """U + inl·sin(2πU/period), a function of the voltage only (domain facts, ADCNL)."""

    inl_v: float
    period_v: float

    identifier: ClassVar[str] = "adc_nonlinearity"
    stage: ClassVar[Stage] = "sampling"
    pointwise: ClassVar[bool] = True
    momentary: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The converter does not convert along a straight line: it is wrong by a wave that depends on the voltage and on"
        " nothing else, the same at every temperature and in every motion."
    )
    equation: ClassVar[str] = "U → U + inl·sin(2π·U/period)"
    coordinate: ClassVar[str] = "output"
    excited_by: ClassVar[str] = "many different rates: a smooth sweep through all voltages"
    look_alikes: ClassVar[tuple[str, ...]] = ("rate_nonlinearity", "rate_squared", "scale_asymmetry")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "inl_v": Parameter(
            unit="V", meaning="peak of the wave", low=-1.0, high=1.0, role="size", scan=(1e-6,), zero=0.0
        ),
        "period_v": Parameter(
            unit="V",
            meaning="voltage from one crest to the next",
            low=0.01,
            high=100.0,
            role="shape",
            scan=(0.1, 0.5, 2.0, 10.0),
            logarithmic=True,
            by_scan=True,
            nudge=1e-5,  # hundreds of periods of 0.01 V fit between the rails
        ),
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the converted output."""
        wave = signals.output_v * (2.0 * math.pi / self.period_v)
        np.sin(wave, out=wave)
        wave *= self.inl_v
        wave += signals.output_v
        return replace(signals, output_v=wave)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The converter is wrong by up to {1e3 * abs(self.inl_v):.3g} mV, in a wave that repeats every"
            f" {self.period_v:.3g} V of output, whatever causes the voltage."
        )
