"""Gain and phase of the output relative to the encoder's rate, above the slow band of the rows.

Motion of a vibrating shaft is compared row by row only in its slow band (`free_band`), where a delay and a low-pass are
equivalent. Above it both instruments are usable wherever their coherence is high: there the phase of the output shows
its delay, the gain its smoothing. Both are compared per frequency bin through the cross-spectrum with the encoder's
rate, for measured and predicted volts alike; signals that only one instrument measures average out.

Noise of the encoder lowers the gain estimated in this way, noise of the output that of the reverse estimate: the true
gain is between the two, a factor γ from each (Bendat & Piersol, Random data, ch. 6; the phase is not biased).
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
"""Coherence above which both instruments measure the same motion."""
_GAIN, _PHASE = 0.05, 0.005
"""Errors of gain and phase [rad] per octave that are not due to noise.

An encoder's steps, motion aliased at half the sampling rate, and smoothing by the output change the gain by some
percent, but hardly the phase.
"""


_TURNING, _FEWEST_ROWS, _FEWEST_STEPS = 0.5, 100, 6
"""Share of the median rate for a row to turn; such rows for a step to count in a direction; minimum of such steps."""
_APART = 0.001
"""Difference of the gains of two directions that is not due to noise: a fiftieth of the error of the gain itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """The comparison, for `steps` (s,) and bins of a frequency `frequency_hz` (k,).

    `instrument` (w, k) is the conjugate spectrum of the encoder's rate in each window, times the window's weight;
    `firsts` (s,) are the first windows of the steps. Predicted cross-spectra times `scale` (s, k) are compared with
    `measured` (s, k), which is about one; `weights` (2, s, k) are the inverse deviations of its gain and phase;
    `gain_v` (k,) is the gain of the output relative to the encoder's rate [V/(°/s)].
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
        """Frequencies of the bins [Hz], shape (k,)."""
        return self.windows.frequency_hz[self.bins]

    @property
    def step(self) -> IntArray:
        """The step of every element of `residual`, shape (2·s·k,)."""
        return np.tile(np.repeat(self.steps, self.bins.size), 2)

    def residual(self, predicted_v: FloatArray) -> FloatArray:
        """Return the errors of predicted volts (n,) in gain and phase, in deviations, shape (2·s·k,)."""
        crossed = np.add.reduceat(self.instrument * self.windows.spectra(predicted_v, self.bins), self.firsts)
        off = self.measured - crossed * self.scale
        return np.concatenate([off.real * self.weights[0], off.imag * self.weights[1]], axis=None)

    def sentence(self, K0_v_per_dps: float) -> str:
        """Return a sentence on the compared band and the gain at its ends."""
        low, high = self.frequency_hz[[0, -1]].tolist()
        first, last = (self.gain_v[[0, -1]] / abs(K0_v_per_dps)).tolist()
        return (
            f"Above that band gain and phase are compared where encoder and gyro see one motion, {low:.3g} to"
            f" {high:.3g} Hz: the gain is {first:.3f} times K0 at the one end, {last:.3f} at the other; what changes"
            f" it by less than {100.0 * _GAIN:.0f} % is not looked for there."
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Contrast:
    """The difference in sensitivity to fast motion between the directions of rotation, in `steps` (s,) with both.

    With `weights` (n,), the sum of volts over a step is the gain of the fast motion in the positive direction less that
    in the negative one: errors common to both directions cancel. `measured` (s,) has the standard error `deviation`.
    """

    weights: FloatArray
    rows: IntArray
    steps: IntArray
    measured: FloatArray
    deviation: float

    def residual(self, predicted_v: FloatArray) -> FloatArray:
        """Return the errors of predicted volts (n,), in deviations, shape (s,)."""
        return (self.measured - np.bincount(self.rows, self.weights * predicted_v)[self.steps]) / self.deviation


def contrast_of(
    *, slow_dps: FloatArray, fast_v: FloatArray, volts: FloatArray, usable: BoolArray, step: IntArray
) -> Contrast | None:
    """Return the contrast of an output, from arrays of shape (n,); None if too few steps turn in both directions.

    `fast_v` is the output caused by motion above the slow band. The deviation is the scatter between steps, plus a
    systematic part for all steps together.
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
    """Return values (n,) in some rows of each step with their mean and their slope along another quantity removed.

    An offset and the slow motion itself then do not change the gain of the fast motion; other rows are 0.
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
    """Return the response above a frequency, from arrays of shape (n,); None if too little is coherent there.

    A bin's variance is that of its noise, plus a systematic part for all bins of an octave together.
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
    """Return the weight of each window, shape (w,), from spectra of shape (w, k).

    Windows in which the two signals agree less than in most (a reversal, a knock, a clock that has slipped) have less
    weight: a redescending estimate of the transfer function by iterated weights (Huber, Robust statistics, 1981, ch.
    7).
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
    """Return how many of the bins (k,) are within half an octave of each, shape (k,)."""
    ordered = np.log2(frequency_hz)
    return np.searchsorted(ordered, ordered + 0.5, "right") - np.searchsorted(ordered, ordered - 0.5, "left")
