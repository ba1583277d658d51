"""An output made by a formula: rest, rates, sines fast and slow, with noise and a converter, and what goes wrong."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.faults import FoundFaults, faults_in, spikes_in

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

INTERVAL_S = 0.01
STEP_V = 10.0 / 2**16
FULL_V = 2.2
LIMIT_V = 4.5


@dataclass(frozen=True, kw_only=True)
class Made:
    """The output as the model predicts it, and as it was recorded; shape (n,) each."""

    predicted: FloatArray
    volts: FloatArray

    def faults(self, *, adc_step_v: float = STEP_V, limit_v: float = LIMIT_V) -> FoundFaults:
        """What is found in it before any fit."""
        return faults_in(
            volts=self.volts,
            predicted=self.predicted,
            foretold=np.ones(self.volts.size, np.bool_),
            stretches=(slice(0, self.volts.size),),
            interval_s=INTERVAL_S,
            adc_step_v=adc_step_v,
            limit_v=limit_v,
        )

    def spikes(self, before: FoundFaults) -> FoundFaults:
        """What is found in its residual."""
        return spikes_in(residual=self.volts - self.predicted, usable=~before.standing, step_v=before.step_v, sudden=())

    def held(self, places: list[int], rows: int) -> Made:
        """With so many rows from each place on that repeat the one before."""
        volts = self.volts.copy()
        for place in places:
            volts[place : place + rows] = volts[place - 1]
        return replace(self, volts=volts)


def motion(rounds: int = 4) -> FloatArray:
    """Volts of rest, rates between ±full scale, sines of 0.15 to 9 Hz and a long slow one, again and again."""
    parts = [np.zeros(1500)]
    before = 0.0
    for share in (0.3, -0.3, 1.0, -1.0, 0.0):
        ramp = before + (share - before) * np.sin(np.linspace(0.0, np.pi / 2, 50)) ** 2
        parts += [ramp, np.full(350, share)]
        before = share
    for peak, frequency, lasts_s in ((0.97, 0.15, 20), (0.6, 0.5, 12), (0.35, 1.5, 8), (0.04, 9.0, 6), (0.3, 0.2, 60)):
        parts.append(peak * np.sin(2 * np.pi * frequency * INTERVAL_S * np.arange(round(lasts_s / INTERVAL_S))))
    return 0.01 + FULL_V * np.tile(np.concatenate(parts), rounds)


def made(
    *,
    noise_v: float = 5e-4,
    step_v: float = STEP_V,
    grows: float = 1.0,
    clipped_v: float = np.inf,
    model_error: float = 1e-3,
    seed: int = 0,
) -> Made:
    """A recording of `motion`; the deviation of the noise grows by the factor `grows` up to full scale.

    The model has the scale wrong by `model_error`.
    """
    chance = np.random.default_rng(seed)
    clean = motion()
    deviation = noise_v * np.sqrt(1.0 + (grows**2 - 1.0) * (clean / FULL_V) ** 2)
    volts = np.clip(clean + deviation * chance.standard_normal(clean.size), -clipped_v, clipped_v)
    return Made(predicted=clean * (1.0 + model_error), volts=np.round(np.rint(volts / step_v) * step_v, 6))
