"""Effect: a low-pass of the output that the model does not include."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Stage
from benchctl_instruments.physics.effects.effect import Parameter
from benchctl_instruments.physics.effects.kinds import FORGETTING_TIME_CONSTANTS, FilterEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorBandwidth(FilterEffect):
    """A Butterworth low-pass of the output, in continuous time (domain facts, LPF).

    At low frequency it is a delay: 1/(2π·cutoff) for order 1, √2/(2π·cutoff) for order 2.
    """

    cutoff_hz: float
    order: float = 2.0

    identifier: ClassVar[str] = "sensor_bandwidth"
    stage: ClassVar[Stage] = "electronics"
    filtered: ClassVar[Literal["output_v", "sensed_rate_dps"]] = "output_v"
    words: ClassVar[str] = (
        "The gyro's output is smoothed by its own electronics: fast motion comes late and too small. Where the motion"
        " is slow against the cutoff it is a delay and nothing else."
    )
    equation: ClassVar[str] = "U → h * U, H(s) = 1/(1 + s/ω_c) or 1/(1 + √2·s/ω_c + (s/ω_c)²), ω_c = 2π·cutoff"
    coordinate: ClassVar[str] = "acceleration"
    excited_by: ClassVar[str] = "reversals and oscillations, the faster the better"
    look_alikes: ClassVar[tuple[str, ...]] = ("timing_offset", "angular_acceleration", "mount_resonance")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "cutoff_hz": Parameter(
            unit="Hz",
            meaning="where the gain has fallen by 3 dB",
            low=0.3,
            high=2000.0,
            role="shape",
            scan=(3.0, 6.0, 12.0, 25.0, 50.0, 100.0, 200.0, 400.0),
            zero=math.inf,
            logarithmic=True,
        ),
        "order": Parameter(unit="1", meaning="poles", low=1.0, high=2.0, role="choice", scan=(1.0, 2.0)),
    }

    def transfer_function(self) -> tuple[FloatArray, FloatArray]:
        """Return numerator and denominator in powers of s, highest first."""
        slowness = 1.0 / (2.0 * math.pi * self.cutoff_hz)
        if round(self.order) == 1:
            return np.array([1.0]), np.array([slowness, 1.0])
        return np.array([1.0]), np.array([slowness**2, math.sqrt(2.0) * slowness, 1.0])

    @property
    def memory_s(self) -> float:
        """The slowest pole is at ω_c, or for order 2 at ω_c/√2."""
        slowest = 1.0 if round(self.order) == 1 else math.sqrt(0.5)
        return FORGETTING_TIME_CONSTANTS / (2.0 * math.pi * self.cutoff_hz * slowest)

    def says(self) -> str:
        """Return the finding in one sentence."""
        slowest = 1.0 if round(self.order) == 1 else math.sqrt(2.0)
        delay_ms = 1e3 * slowest / (2.0 * math.pi * self.cutoff_hz)
        order = "first" if round(self.order) == 1 else "second"
        return (
            f"The gyro's output is smoothed by a low-pass of {order} order with a cutoff of {self.cutoff_hz:.3g} Hz:"
            f" slow motion comes {delay_ms:.2g} ms late, fast motion also too small."
        )
