"""Effect: mains pickup in the output."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class MainsPickup(PhysicalEffect):
    """U + amplitude·sin(2π·frequency·t + phase) (domain facts, MAINS).

    t counts from `start_s`. A line above half the sample rate appears at its alias; frequencies with the same alias
    cannot be distinguished.
    """

    amplitude_v: float
    frequency_hz: float
    phase_deg: float = 0.0
    start_s: float = 0.0

    identifier: ClassVar[str] = "mains_pickup"
    stage: ClassVar[Stage] = "sampling"
    pointwise: ClassVar[bool] = True
    words: ClassVar[str] = (
        "The cables pick up an alternating voltage, of the mains or of a motor drive: a line of constant amplitude at"
        " a frequency that has nothing to do with the motion."
    )
    equation: ClassVar[str] = "U → U + amplitude·sin(2π·frequency·t + phase)"
    coordinate: ClassVar[str] = "frequency"
    excited_by: ClassVar[str] = "nothing: it is there at rest too"
    look_alikes: ClassVar[tuple[str, ...]] = ("encoder_interpolation", "mount_resonance", "heading_dependent_bias")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "amplitude_v": Parameter(
            unit="V", meaning="peak of the line", low=0.0, high=10.0, role="size", scan=(1e-6,), zero=0.0
        ),
        "frequency_hz": Parameter(
            unit="Hz",
            meaning="frequency of the line, or its alias",
            low=0.1,
            high=1e4,
            role="shape",
            scan=(50.0, 60.0, 100.0, 120.0, 150.0, 400.0),
            logarithmic=True,
            by_scan=True,
            nudge=1e-9,  # 50 Hz is 10⁶ rad in an hour
        ),
        "phase_deg": Parameter(
            unit="degree", meaning="phase of the sine at t = 0", low=0.0, high=360.0, role="phase", scan=(0.0, 90.0)
        ),
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with the line."""
        line = signals.time_s - self.start_s
        line *= 2.0 * math.pi * self.frequency_hz
        line += math.radians(self.phase_deg)
        np.sin(line, out=line)
        line *= self.amplitude_v
        line += signals.output_v
        return replace(signals, output_v=line)

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The output carries a line of {1e3 * self.amplitude_v:.3g} mV at {self.frequency_hz:.6g} Hz, whatever the"
            " table does: pickup of the mains or of a drive."
        )
