"""Effect: converter steps larger than specified."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class AdcCoarse(PhysicalEffect):
    """U rounded to steps of 2^bits_lost of the converter's own step `adc_step_v` (domain facts, QNT).

    It acts on the samples with their noise. If the noise is large compared with a step, it adds a little white noise;
    otherwise the output is quantized.
    """

    bits_lost: float
    adc_step_v: float = 20.0 / 65536.0

    identifier: ClassVar[str] = "adc_coarse"
    stage: ClassVar[Stage] = "sampling"
    pointwise: ClassVar[bool] = True
    momentary: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The lower bits of the converter do not move: the output comes in steps larger than those of the converter, so"
        " that small changes of the rate vanish or come as jumps."
    )
    equation: ClassVar[str] = "U → q·round(U/q), q = step·2^bits_lost"
    coordinate: ClassVar[str] = "output"
    excited_by: ClassVar[str] = "rest and slow motion, where the noise is smaller than a step"
    look_alikes: ClassVar[tuple[str, ...]] = ("adc_nonlinearity", "dead_zone")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "bits_lost": Parameter(
            unit="1",
            meaning="lower bits that do not move",
            low=0.0,
            high=12.0,
            role="choice",
            scan=tuple(float(bits) for bits in range(1, 11)),
            zero=0.0,
        )
    }

    @property
    def step_v(self) -> float:
        """The remaining step [V]."""
        return float(self.adc_step_v * 2.0**self.bits_lost)

    def apply(self, signals: Signals) -> Signals:
        """Return the quantized output."""
        if self.bits_lost <= 0.0:
            return signals
        volts = signals.output_v * (1.0 / self.step_v)
        np.rint(volts, out=volts)
        volts *= self.step_v
        return replace(signals, output_v=volts)

    def says(self) -> str:
        """Return the finding in one sentence."""
        bits = round(self.bits_lost)
        idle = "the lowest bit of the converter does" if bits == 1 else f"the lowest {bits} bits of the converter do"
        return f"The output comes in steps of {1e3 * self.step_v:.3g} mV: {idle} not move."
