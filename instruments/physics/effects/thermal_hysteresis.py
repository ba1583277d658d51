"""Effect: thermal hysteresis of the scale factor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalHysteresis(PhysicalEffect):
    """The scale factor is × (1 + fraction_per_c·(play(T; ±width) − T)) (domain facts, THYS).

    play is the backlash operator: it is constant while T moves within ±width of it, is pushed along otherwise, and
    starts at the first T. It depends on the path, not on time: between segments T is assumed to be linear.
    """

    width_c: float
    fraction_per_c: float

    identifier: ClassVar[str] = "thermal_hysteresis"
    stage: ClassVar[Stage] = "scale"
    timeless: ClassVar[bool] = True
    words: ClassVar[str] = (
        "At the same temperature the scale factor is another one after heating than after cooling, however long one"
        " waits: something in the coil's winding follows the temperature with friction."
    )
    equation: ClassVar[str] = "U − U0 → (U − U0)·(1 + fraction_per_c·(play(T; ±width) − T))"
    coordinate: ClassVar[str] = "rate*gyro_temp"
    excited_by: ClassVar[str] = "rotation at the same temperatures, reached from below and from above"
    look_alikes: ClassVar[tuple[str, ...]] = ("thermal_lag", "scale_temperature", "scale_warm_up", "scale_ageing")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "width_c": Parameter(
            unit="degC",
            meaning="half of the backlash",
            low=0.01,
            high=60.0,
            role="shape",
            scan=(0.5, 1.0, 2.0, 4.0, 8.0, 16.0),
            zero=0.0,
            logarithmic=True,
        ),
        "fraction_per_c": Parameter(
            unit="degC-1",
            meaning="relative change of the scale factor a degree of it",
            low=-0.05,
            high=0.05,
            role="size",
            scan=(1e-6,),
            zero=0.0,
        ),
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with a scale factor that depends on the temperature path."""
        start = float(signals.memory.get(self.identifier, signals.coil_c)[0])
        volts = play(signals.coil_c, self.width_c, start)
        kept = volts[-1:].copy()
        volts -= signals.coil_c
        volts *= self.fraction_per_c
        volts += 1.0
        volts *= signals.output_v
        return replace(signals, output_v=volts, memory={**signals.memory, self.identifier: kept})

    def says(self) -> str:
        """Return the finding in one sentence."""
        apart = 2.0 * self.width_c * self.fraction_per_c
        return (
            f"The scale factor is {100.0 * abs(apart):.3g} % {'lower' if apart > 0.0 else 'higher'} after heating than"
            f" after cooling to the same temperature, however long one waits: it follows with a backlash of"
            f" ±{self.width_c:.3g} °C."
        )


def play(x: FloatArray, half_width: float, start: float) -> FloatArray:
    """Return the backlash operator p ← min(max(p, x − half_width), x + half_width), started at `start`; shapes (n,).

    Any segment of samples maps the p before it to the p after it by a single clamp. The samples are therefore cut into
    √n segments: first the clamps of all segments are computed together, then p between them, then p inside all of them.
    """
    length = math.isqrt(x.size - 1) + 1
    count = -(-x.size // length)
    padded = np.full(length * count, x[-1])
    padded[: x.size] = x
    columns = np.ascontiguousarray(padded.reshape(count, length).T)
    below, above = columns - half_width, columns + half_width
    lowest, highest = below[0].copy(), above[0].copy()
    for low, high in zip(below[1:], above[1:], strict=True):
        _clamp(lowest, low, high)
        _clamp(highest, low, high)
    inside = np.empty(count)
    for stretch, (low, high) in enumerate(zip(lowest, highest, strict=True)):
        inside[stretch] = start
        start = min(max(start, low), high)
    for low, high in zip(below, above, strict=True):
        _clamp(inside, low, high)
        low[:] = inside
    played: FloatArray = below.T.ravel()[: x.size]
    return played


def _clamp(p: FloatArray, low: FloatArray, high: FloatArray) -> None:
    np.maximum(p, low, out=p)
    np.minimum(p, high, out=p)
