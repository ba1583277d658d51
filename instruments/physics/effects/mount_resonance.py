"""Effect: resonance of the gyro's mount."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Stage
from benchctl_instruments.physics.effects.effect import Parameter
from benchctl_instruments.physics.effects.kinds import FORGETTING_TIME_CONSTANTS, FilterEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class MountResonance(FilterEffect):
    """Base excitation of a spring and damper between table and gyro (domain facts, RES).

    The gyro's rate is the table's rate filtered by (2ζωₙs + ωₙ²)/(s² + 2ζωₙs + ωₙ²).
    """

    frequency_hz: float
    damping: float

    identifier: ClassVar[str] = "mount_resonance"
    stage: ClassVar[Stage] = "sensed_rate"
    momentary: ClassVar[bool] = True
    filtered: ClassVar[Literal["output_v", "sensed_rate_dps"]] = "sensed_rate_dps"
    words: ClassVar[str] = (
        "The gyro sits on something that gives way like a spring: it overshoots and rings after every reversal, and"
        " near its resonance it turns further than the table does. The encoder sees none of that."
    )
    equation: ClassVar[str] = "Ω → h * Ω, H(s) = (2ζωₙs + ωₙ²)/(s² + 2ζωₙs + ωₙ²), ωₙ = 2π·frequency, ζ = damping"
    coordinate: ClassVar[str] = "acceleration"
    excited_by: ClassVar[str] = "reversals, and oscillations near the resonance"
    look_alikes: ClassVar[tuple[str, ...]] = ("sensor_bandwidth", "timing_offset", "angular_acceleration")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "frequency_hz": Parameter(
            unit="Hz",
            meaning="natural frequency ωₙ/2π of the gyro on its mount",
            low=0.3,
            high=2000.0,
            role="shape",
            scan=(3.0, 5.0, 8.0, 12.0, 18.0, 27.0, 40.0, 60.0, 90.0, 140.0, 200.0),
            zero=math.inf,
            logarithmic=True,
        ),
        "damping": Parameter(
            unit="1",
            meaning="damping ratio ζ",
            low=0.002,
            high=0.5,  # a loss factor of one, larger than that of most rubbers: there is no resonance above
            role="shape",
            scan=(0.02, 0.1, 0.4),
            logarithmic=True,
        ),
    }

    def assuming(self, names: Collection[str]) -> MountResonance | None:
        """Return it with an assumed damping: motion below the resonance determines only the rise of the gain."""
        if set(names) != {"damping"}:
            return None
        likely = min(self.parameters["damping"].scan, key=lambda one: abs(math.log(one / self.damping)))
        return _BelowResonance(frequency_hz=self.frequency_hz, damping=likely)

    def transfer_function(self) -> tuple[FloatArray, FloatArray]:
        """Return numerator and denominator in powers of s, highest first."""
        slowness = 1.0 / (2.0 * math.pi * self.frequency_hz)
        damped = 2.0 * self.damping * slowness
        return np.array([damped, 1.0]), np.array([slowness**2, damped, 1.0])

    @property
    def memory_s(self) -> float:
        """The slowest pole is at ζωₙ, above critical damping at (ζ − √(ζ² − 1))·ωₙ."""
        slowest = self.damping - math.sqrt(max(self.damping**2 - 1.0, 0.0))
        return FORGETTING_TIME_CONSTANTS / (2.0 * math.pi * self.frequency_hz * slowest)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The gyro's mount gives way: it rings at {self.frequency_hz:.3g} Hz with a damping ratio of"
            f" {self.damping:.2g}, which the encoder does not see."
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _BelowResonance(MountResonance):
    """A mount whose resonance is above the frequencies of the motion, which does not determine its damping."""

    parameters: ClassVar[Mapping[str, Parameter]] = {
        **MountResonance.parameters,
        "damping": replace(MountResonance.parameters["damping"], role="assumed"),
    }

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            "The gyro's mount gives way: the gain rises with frequency, towards a resonance at"
            f" {self.frequency_hz:.3g} Hz, which the encoder does not see. The motion stays below it: the damping ratio"
            f" of {self.damping:.2g} is assumed, not measured."
        )
