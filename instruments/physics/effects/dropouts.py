"""Effect: the output is held for some time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.draws import generator
from benchctl_instruments.physics.effects.effect import Parameter
from benchctl_instruments.physics.effects.kinds import NoiseEffect

_MISSED_SCAN = 1.5
"""Time between two samples, in scan intervals, from which a scan counts as missing between them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Dropouts(NoiseEffect):
    """At `count` scans of every `span_scans` the output is held for a time (domain facts, GAP).

    The scans are random, with equal probability at every scan.
    """

    count: float
    hold_s: float
    span_scans: float = 400_000.0
    seed: int = 1

    identifier: ClassVar[str] = "dropouts"
    stage: ClassVar[Stage] = "sampling"
    words: ClassVar[str] = (
        "Now and then the output is held: the same sample comes again and again for a while, although the gyro turns"
        " and its noise goes on. Then the data are right again."
    )
    equation: ClassVar[str] = "U(t) → U(t_k) for t_k ≤ t < t_k + hold, at count instants t_k"
    coordinate: ClassVar[str] = "time"
    excited_by: ClassVar[str] = "nothing: they come at any time, and are plain while the rate changes"
    look_alikes: ClassVar[tuple[str, ...]] = ("outliers",)
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "count": Parameter(
            unit="1",
            meaning="how often the output was held",
            low=1.0,
            high=10_000.0,
            role="shape",
            scan=(1.0, 10.0, 100.0),
            zero=0.0,
            logarithmic=True,
        ),
        "hold_s": Parameter(
            unit="s",
            meaning="how long each time",
            low=1e-4,
            high=100.0,
            role="shape",
            scan=(0.02, 0.2, 2.0),
            zero=0.0,
            logarithmic=True,
        ),
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with its holds; a hold from the previous segment continues."""
        volts = signals.output_v
        held = self._held(signals)
        if held.any():
            before, last_s, last_v = signals.memory.get(self.identifier, (-np.inf, -np.inf, 0.0))
            waited_s = signals.time_s[0] - last_s
            goes_on = before == signals.first_index and waited_s < _MISSED_SCAN * signals.interval_s
            source = np.where(held, 0, np.arange(volts.size))
            np.maximum.accumulate(source, out=source)
            volts = volts[source]
            if held[0] and goes_on:
                volts[source == 0] = last_v
        kept = np.array([signals.first_index + volts.size, signals.time_s[-1], volts[-1]])
        return replace(signals, output_v=volts, memory={**signals.memory, self.identifier: kept})

    def _held(self, signals: Signals) -> npt.NDArray[np.bool_]:
        """Return which scans repeat the previous one, shape (n,)."""
        first, scans = signals.first_index, signals.time_s.size
        length = round(self.hold_s / signals.interval_s)
        held = np.zeros(scans, np.bool_)
        span = int(self.span_scans)
        for block in range(max(first - length, 0) // span, (first + scans - 1) // span + 1):
            chance = generator(self.seed, self.identifier, block).random(round(self.count))
            starts = np.floor((block + chance) * span).astype(np.int64) - first
            for start in starts[(starts > -length) & (starts < scans)].tolist():
                held[max(start + 1, 0) : max(start + length, 0)] = True
        return held

    def says(self) -> str:
        """Return the finding in one sentence."""
        often = "once" if round(self.count) == 1 else f"{self.count:.0f} times"
        return f"The output is held {often}, for {self.hold_s:.3g} s: it repeats one sample while the gyro goes on."
