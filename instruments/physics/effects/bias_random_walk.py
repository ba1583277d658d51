"""Effect: random walk of the bias."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.draws import normals
from benchctl_instruments.physics.effects.effect import Parameter
from benchctl_instruments.physics.effects.kinds import NoiseEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasRandomWalk(NoiseEffect):
    """U + v·∫n dt, n white noise of unit density (domain facts, BRW).

    The walk is zero at `start_s`; during a time t its variance grows by v²·t, in gaps between streams too.
    """

    v_per_sqrt_s: float
    start_s: float = 0.0
    seed: int = 1

    identifier: ClassVar[str] = "bias_random_walk"
    stage: ClassVar[Stage] = "sampling"
    words: ClassVar[str] = (
        "The bias wanders without a cause that was recorded: each moment it moves a little further, up or down by"
        " chance, so that it strays with the root of the time."
    )
    equation: ClassVar[str] = "U → U + v·∫n dt, n white of unit density"
    coordinate: ClassVar[str] = "time"
    excited_by: ClassVar[str] = "nothing: it is plain in long rests, and in runs that are repeated hours later"
    look_alikes: ClassVar[tuple[str, ...]] = ("flicker_noise", "bias_drift", "warm_up", "bias_temperature")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "v_per_sqrt_s": Parameter(
            unit="V s-0.5",
            meaning="deviation of the bias after one second",
            low=0.0,
            high=1.0,
            role="size",
            scan=(1e-6,),
            zero=0.0,
        )
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with its wandering bias; a reading older than the last one gets the last bias."""
        last_s, value = signals.memory.get(self.identifier, (self.start_s, 0.0))
        steps = np.diff(np.maximum(signals.time_s, last_s), prepend=last_s)
        np.sqrt(steps, out=steps)
        steps *= normals(self.seed, self.identifier, signals.first_index, steps.size, 1)[:, 0]
        steps *= self.v_per_sqrt_s
        steps[0] += value
        walk = np.cumsum(steps, out=steps)
        kept = np.array([max(last_s, signals.time_s[-1]), walk[-1]])
        walk += signals.output_v
        return replace(signals, output_v=walk, memory={**signals.memory, self.identifier: kept})

    def says(self) -> str:
        """Return the finding in one sentence."""
        hour_mv = 1e3 * self.v_per_sqrt_s * 60.0
        return (
            f"The bias wanders by chance, {1e6 * self.v_per_sqrt_s:.3g} µV in a second and {hour_mv:.3g} mV in an hour"
            " (standard deviation): no temperature and no motion accounts for it."
        )
