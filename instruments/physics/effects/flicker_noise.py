"""Effect: flicker noise of the bias, with equal power in every decade of frequency."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import scipy  # scipy.signal is loaded on first use

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.draws import generator, normals
from benchctl_instruments.physics.effects.effect import Parameter
from benchctl_instruments.physics.effects.kinds import NoiseEffect

_SLOWEST = 17
"""The longest time constant is two seconds to this power; its corner frequency is 1.2 µHz."""


def time_constants_s(interval_s: float) -> FloatArray:
    """Return the time constants of the summed processes, an octave apart; the fastest is nearly white between scans."""
    return np.asarray(2.0 ** np.arange(math.floor(math.log2(interval_s / 2.0)), _SLOWEST + 1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class FlickerNoise(NoiseEffect):
    """U + n with n of the one-sided density S(f) = v²/(ln 10·f), f from 2 µHz to half the scan rate (domain, FLK).

    The integral of S over a decade of frequency is v²: `v_rms_per_decade` is the rms of the noise between a frequency
    and ten times it. The Allan deviation is flat at v·√(2·ln 2/ln 10) = 0.776·v: divided by the scale factor, the bias
    instability.

    The noise is a sum of first-order (Ornstein-Uhlenbeck) processes an octave apart, each of variance v²·log10(2) and
    exact at the scan instants for any spacing; it is stationary from the first scan on.
    """

    v_rms_per_decade: float
    seed: int = 1

    identifier: ClassVar[str] = "flicker_noise"
    stage: ClassVar[Stage] = "sampling"
    words: ClassVar[str] = (
        "The bias flickers: it moves by chance as much in a second as in a minute and in an hour, so that longer means"
        " do not make it any better known (the bias instability of data sheets)."
    )
    equation: ClassVar[str] = "U → U + n, S_n(f) = v²/(ln 10·f)"
    coordinate: ClassVar[str] = "time"
    excited_by: ClassVar[str] = "nothing: it is plain in long rests"
    look_alikes: ClassVar[tuple[str, ...]] = ("bias_random_walk", "bias_drift", "warm_up", "bias_temperature")
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "v_rms_per_decade": Parameter(
            unit="V",
            meaning="rms of the noise within a decade of frequency",
            low=0.0,
            high=1.0,
            role="size",
            scan=(1e-6,),
            zero=0.0,
        )
    }

    def apply(self, signals: Signals) -> Signals:
        """Return the output with flicker noise of the bias."""
        taus_s = time_constants_s(signals.interval_s)
        count = taus_s.size
        last_s, *values = signals.memory.get(self.identifier, (signals.time_s[0],))
        states = (
            np.asarray(values) if values else generator(self.seed, f"{self.identifier} start", 0).normal(size=count)
        )
        chance = normals(self.seed, self.identifier, signals.first_index, signals.time_s.size, count)
        waited_s = max(signals.time_s[0] - last_s, 0.0)
        flicker = np.zeros(signals.time_s.size)
        ends = np.empty(count)
        for k, tau_s in enumerate(taus_s.tolist()):
            first = states[k] * math.exp(-waited_s / tau_s) + chance[0, k] * _fresh(waited_s / tau_s)
            decay = math.exp(-signals.interval_s / tau_s)
            pushes = chance[:, k] * _fresh(signals.interval_s / tau_s)
            pushes[0] = first
            process = scipy.signal.lfilter([1.0], [1.0, -decay], pushes)
            flicker += process
            ends[k] = process[-1]
        flicker *= self.v_rms_per_decade * math.sqrt(math.log10(2.0))
        flicker += signals.output_v
        kept = np.array([max(last_s, signals.time_s[-1]), *ends])
        return replace(signals, output_v=flicker, memory={**signals.memory, self.identifier: kept})

    def says(self) -> str:
        """Return the finding in one sentence."""
        return (
            f"The bias flickers, {1e6 * self.v_rms_per_decade:.3g} µV rms in every decade of frequency: no temperature"
            " and no motion accounts for it, and longer means do not help."
        )


def _fresh(times: float) -> float:
    """Return the deviation of the random part of a process of unit variance after `times` time constants."""
    return math.sqrt(-math.expm1(-2.0 * times))
