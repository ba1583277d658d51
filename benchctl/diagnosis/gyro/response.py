"""Gain and phase of the output against the encoder's rate, where the rows of a slow band do not reach.

Motion of a shaft that shakes is compared row by row only in its slow band (`free_band`), where a delay and a low-pass
are one. Above it both instruments still speak wherever their coherence is high: there the output's phase tells how
late it is, its gain whether it was smoothed. Both are compared bin by bin through the cross-spectrum with the encoder's
rate, measured and predicted volts alike; what only one of the two sees averages out.

Noise of the encoder lowers the gain that is seen this way, noise of the output that of the reverse: the truth lies
between the two, γ apart each (Bendat & Piersol, Random data, ch. 6; the phase is not biased).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchctl.signals.rate import WIDE, edges_hz
from benchctl.signals.windows import INDEPENDENT, Windows, windows_of
from benchctl_instruments.arrays import BoolArray, ComplexArray, FloatArray, IntArray

_WINDOW_S = 1.28
_FEWEST_WINDOWS = 16
_ROUNDS, _USUAL = 20, 0.25
_COHERENT = 0.9
"""Coherence from which on both are taken to see one motion."""
_GAIN, _PHASE = 0.05, 0.005
"""What gain and phase [rad] of an octave may be wrong by for other reasons than noise.

An encoder's steps, motion folded back at half the sampling rate and the output's own smoothing change the gain by some
percent, the phase hardly.
"""


_TURNING, _FEWEST_ROWS, _FEWEST_STEPS = 0.5, 100, 6
"""A step turns in a direction where so many of its rows do, at such a share of the usual rate; of so many steps."""
_APART = 0.001
"""What the gains of two directions may differ by for other reasons: a fiftieth of what a gain may be wrong by."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """The comparison, for `steps` (s,) and bins of a frequency `frequency_hz` (k,).

    `instrument` (w, k) is the conjugate spectrum of the encoder's rate in each window, times what the window counts;
    `firsts` (s,) are the steps' first windows. Predicted cross-spectra times `scale` (s, k) are to be `measured`
    (s, k), which is about one; `weights` (2, s, k) are the inverse of the deviations of its gain and phase; `gain_v`
    (k,) is the output's over the encoder's rate [V/(°/s)].
    """

    windows: Windows
    bins: IntArray
    steps: IntArray
    firsts: IntArray
    instrument: ComplexArray
    scale: ComplexArray
    measured: ComplexArray
    weights: FloatArray
    gain_v: FloatArray

    @property
    def frequency_hz(self) -> FloatArray:
        """The bins that are compared [Hz], shape (k,)."""
        return self.windows.frequency_hz[self.bins]

    @property
    def step(self) -> IntArray:
        """The step of every number of `residual`, shape (2·s·k,)."""
        return np.tile(np.repeat(self.steps, self.bins.size), 2)

    def residual(self, predicted_v: FloatArray) -> FloatArray:
        """How far predicted volts (n,) are off in gain and in phase, in deviations, shape (2·s·k,)."""
        crossed = np.add.reduceat(self.instrument * self.windows.spectra(predicted_v, self.bins), self.firsts)
        off = self.measured - crossed * self.scale
        return np.concatenate([off.real * self.weights[0], off.imag * self.weights[1]], axis=None)

    def says(self, K0_v_per_dps: float) -> str:
        """What is compared, and how the gain runs."""
        low, high = self.frequency_hz[[0, -1]].tolist()
        first, last = (self.gain_v[[0, -1]] / abs(K0_v_per_dps)).tolist()
        return (
            f"Above that band gain and phase are compared where encoder and gyro see one motion, {low:.3g} to"
            f" {high:.3g} Hz: the gain is {first:.3f} times K0 at the one end, {last:.3f} at the other; what changes"
            f" it by less than {100.0 * _GAIN:.0f} % is not looked for there."
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Contrast:
    """By how much more the fast motion is felt in the one direction of rotation, in `steps` (s,) that have both.

    `weights` (n,) make of volts, summed over a step, the gain of the fast motion in the positive direction less that in
    the negative one: whatever makes it wrong alike in both is not in it. `measured` (s,) is off by `deviation`.
    """

    weights: FloatArray
    rows: IntArray
    steps: IntArray
    measured: FloatArray
    deviation: float

    def residual(self, predicted_v: FloatArray) -> FloatArray:
        """How far predicted volts (n,) are off, in deviations, shape (s,)."""
        return (self.measured - np.bincount(self.rows, self.weights * predicted_v)[self.steps]) / self.deviation


def contrast_of(
    *, slow_dps: FloatArray, fast_v: FloatArray, volts: FloatArray, usable: BoolArray, step: IntArray
) -> Contrast | None:
    """The contrast of an output, from arrays of shape (n,); None where too few steps turn in both directions.

    `fast_v` is what the motion above the slow band makes of the output. The deviation is what steps differ by, and, of
    all steps together, what else may be wrong.
    """
    turning = usable & (np.abs(slow_dps) > _TURNING * np.median(np.abs(slow_dps[usable])))
    count = int(step[-1]) + 1
    weights, both = np.zeros(volts.size), np.ones(count, np.bool_)
    for sign in (-1.0, 1.0):
        rows = turning & (np.sign(slow_dps) == sign)
        both &= np.bincount(step, rows, count) >= _FEWEST_ROWS
        own = _beside_line(fast_v, slow_dps, rows, step)
        power = np.bincount(step, own**2, count)[step]
        np.divide(sign * own, power, out=weights, where=rows & (power > 0.0))
    steps = np.flatnonzero(both)
    if steps.size < _FEWEST_STEPS:
        return None
    measured = np.asarray(np.bincount(step, weights * np.where(usable, volts, 0.0))[steps], np.float64)
    deviation = math.sqrt(float(measured.var(ddof=1)) + (_APART**2) * steps.size)
    return Contrast(weights=weights, rows=step, steps=steps, measured=measured, deviation=deviation)


def _beside_line(values: FloatArray, along: FloatArray, rows: BoolArray, step: IntArray) -> FloatArray:
    """What of values (n,) is in some rows of each step neither constant nor in proportion to another quantity.

    An offset, and the slow motion itself, are then no gain of the fast one; 0 in all other rows.
    """
    many = np.maximum(np.bincount(step, rows), 1.0)
    own, other = ((one - (np.bincount(step, one * rows) / many)[step]) * rows for one in (values, along))
    power = np.bincount(step, other**2)
    slope = np.divide(np.bincount(step, own * other), power, out=np.zeros_like(power), where=power > 0.0)
    return np.asarray(own - slope[step] * other)


def response_of(
    *,
    rate_dps: FloatArray,
    volts: FloatArray,
    usable: BoolArray,
    stretches: Sequence[slice],
    step: IntArray,
    interval_s: float,
    above_hz: float,
) -> Response | None:
    """The response above a frequency, from arrays of shape (n,); None where too little is coherent there.

    A bin's deviation is that of its noise, and, an octave's bins taken together, what else may be wrong.
    """
    size = 1 << round(math.log2(_WINDOW_S / interval_s))
    windows = windows_of(usable, stretches, size, interval_s)
    if windows.starts.size < _FEWEST_WINDOWS:
        return None
    passing_hz, _ = edges_hz(WIDE, 1.0 / interval_s)
    frequency = windows.frequency_hz
    bins = np.flatnonzero((frequency > above_hz) & (frequency <= passing_hz))
    rate, output = windows.spectra(rate_dps, bins), windows.spectra(volts, bins)
    trust = _trust(rate, output)
    instrument = rate.conj() * trust[:, None]
    of_rate, shared = (np.sum(instrument * other, axis=0) for other in (rate, output))
    powers = of_rate.real * (trust @ np.abs(output) ** 2)
    coherence = np.minimum(np.abs(shared) ** 2 / np.maximum(powers, 1e-300), 1.0 - 1e-9)
    kept = np.flatnonzero(coherence >= _COHERENT)
    if not kept.size:
        return None
    bins, coherence, instrument = bins[kept], coherence[kept], instrument[:, kept]
    steps, firsts = np.unique(step[windows.starts + size // 2], return_index=True)
    own = np.add.reduceat(instrument * rate[:, kept], firsts).real
    gain = shared[kept] / of_rate[kept] / np.sqrt(coherence)
    scale = np.divide(1.0, own * gain, out=np.zeros_like(own, np.complex128), where=own > 0.0)
    noise = (1.0 - coherence) / (2.0 * coherence) / (INDEPENDENT * trust.sum() ** 2 / (trust @ trust))
    octave = _in_octave(frequency[bins])
    between = 0.5 * np.log(coherence)
    deviations = np.sqrt([(_GAIN**2 + between**2) * octave + noise, _PHASE**2 * octave + noise])
    return Response(
        windows=windows,
        bins=bins,
        steps=steps,
        firsts=firsts,
        instrument=instrument,
        scale=scale,
        measured=np.add.reduceat(instrument * output[:, kept], firsts) * scale / np.sqrt(coherence),
        weights=np.sqrt(own / of_rate[kept].real) / deviations[:, None, :],
        gain_v=np.abs(gain),
    )


def _trust(rate: ComplexArray, output: ComplexArray) -> FloatArray:
    """How much each window counts, shape (w,), from spectra of shape (w, k).

    Windows in which the two have less in common than in most (a reversal, a knock, a clock that has slipped) count the
    less: a redescending estimate of the transfer function by iterated weights (Huber, Robust statistics, 1981, ch. 7).
    """
    trust = np.ones(len(rate))
    for _ in range(_ROUNDS):
        gain = (trust @ (rate.conj() * output)) / np.maximum(trust @ np.abs(rate) ** 2, 1e-300)
        power = np.sum(np.abs(rate * gain) ** 2, axis=1)
        off = np.sum(np.abs(output - rate * gain) ** 2, axis=1) / np.maximum(power, 1e-300)
        usual = max(float(np.quantile(off, _USUAL)), 1e-300)
        trust = (usual / (usual + off)) ** 2
    return trust


def _in_octave(frequency_hz: FloatArray) -> IntArray:
    """How many of the bins (k,) lie within half an octave of each, shape (k,)."""
    ordered = np.log2(frequency_hz)
    return np.searchsorted(ordered, ordered + 0.5, "right") - np.searchsorted(ordered, ordered - 0.5, "left")
