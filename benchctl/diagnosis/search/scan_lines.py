"""Scan over all line numbers of an encoder's grating, for an error that repeats from line to line.

Such an error e(θ) changes the prediction by −∂U/∂ω·F(e), with the filter F that makes rates of angles. The transposed
filter maps the residual to a pull on the angles, and one Fourier transform over the turn gives its products with
sin(N·θ) and cos(N·θ) for all N.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.fft

from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.search.pull import Place, Pull, paid, peaks
from benchctl.signals.binning import line_scores
from benchctl.signals.rate import NARROW, differentiator, edges_hz, transposed
from benchctl_instruments.arrays import FloatArray

_FEWEST = 9
"""Smallest number of lines; lower orders are encoder errors such as eccentricity."""

_NUDGE_DPS = 1e-3
_STEP_RAD = 1e-6
"""Resolution of the turn from row to row: at 100 000 lines it is a sixtieth of a period."""

_EVERY = 8
_PADDED = 8
_APART = 20
"""Distance below which line numbers are not distinguished, for motion that covers only a part of a turn."""


def line_places(problem: GyroProblem, pull: Pull, most: int, count: int) -> list[Place]:
    """Return the most promising integer numbers of lines per turn, up to `most`, the most promising first."""
    frame = problem.frame
    every_row, information = _at_every_row(problem, pull)
    slope = _volts_per_dps(problem, pull)
    felt = np.empty_like(every_row)
    for part, motion in zip(frame.stretches, frame.motions, strict=True):
        narrow, wide = motion.filters
        pulled = -every_row[part] * slope[part]
        felt[part] = transposed(pulled * (1.0 - motion.sudden), narrow) + transposed(pulled * motion.sudden, wide)
    scores = line_scores(felt, frame.encoder_deg, most)
    power = _powers(problem, information * slope**2, most)
    gain = np.abs(scores) ** 2 / np.maximum(power, 1e-9 * power.max() + 1e-300)
    gain[:_FEWEST] = 0.0
    level = float(np.median(gain[_FEWEST:])) / (2.0 * math.log(2.0))
    return [
        Place(float(lines), float(gain[lines]), paid(float(most - _FEWEST + 1), float(gain[lines]), level))
        for lines in peaks(gain, count, _APART)
    ]


def _at_every_row(problem: GyroProblem, pull: Pull) -> tuple[FloatArray, FloatArray]:
    """Return pull and information at all rows of the frame; a problem with a band has only some of them."""
    if problem.band is None:
        return pull.pull, pull.information
    frame = problem.frame
    pulled, information = np.zeros(frame.rows), np.zeros(frame.rows)
    pulled[problem.band.rows], information[problem.band.rows] = pull.pull, pull.information
    kernel = _slow(problem)
    return np.concatenate([transposed(pulled[part], kernel) for part in frame.stretches]), information


def _slow(problem: GyroProblem) -> FloatArray:
    rate_hz = 1.0 / problem.frame.interval_s
    return differentiator(rate_hz, *edges_hz(NARROW, rate_hz), 0)


def _volts_per_dps(problem: GyroProblem, pull: Pull) -> FloatArray:
    """Return ∂U/∂ω of the fitted model, shape (n,)."""
    frame, law = problem.frame, problem.chain.law
    more, less = (
        law.volts(pull.fitted.point.baseline, frame.rate_dps + nudge, frame.temp_c)
        for nudge in (_NUDGE_DPS, -_NUDGE_DPS)
    )
    return np.asarray((more - less) / (2.0 * _NUDGE_DPS))


def _powers(problem: GyroProblem, weight: FloatArray, most: int) -> FloatArray:
    """Return half of Σ weight·|gain|² of unit waves for every number of lines up to `most`, shape (most+1,).

    Over the length of the filter, a row's wave has the frequency that its rate gives it, aliased or not. The squared
    gain is a cosine series in the phase from row to row, with the autocorrelation of the filter taps as coefficients;
    it therefore needs only the characteristic function of the rows' turns.
    """
    frame = problem.frame
    kernels = frame.motions[0].filters
    if problem.band is not None:
        kernels = (np.convolve(kernels[0], _slow(problem)), np.convolve(kernels[1], _slow(problem)))
    cell = np.floor(np.abs(np.radians(frame.rate_dps)) * frame.interval_s / _STEP_RAD).astype(np.int64)
    bins = int(cell.max()) + 1
    size = scipy.fft.next_fast_len(_PADDED * bins, real=True)
    orders = np.append(np.arange(0, most, _EVERY), most)
    share = frame.sudden
    total = np.zeros(orders.size)
    for mixed, a, b in ((1.0 - share) ** 2, 0, 0), (2.0 * share * (1.0 - share), 0, 1), (share**2, 1, 1):
        turned = scipy.fft.rfft(np.bincount(cell, weight * mixed, minlength=bins), size)
        # beyond the last, turns are no longer resolved: all phases of the wave occur equally
        characteristic = np.append((turned * np.exp(-1j * np.pi / size * np.arange(turned.size))).real, 0.0)
        taps = np.correlate(kernels[a], kernels[b], "full")
        middle = taps.size // 2
        total += taps[middle] * characteristic[0]
        for lag in range(1, middle + 1):
            at = np.rint(orders * (lag * _STEP_RAD * size / (2.0 * np.pi))).astype(np.int64)
            both = taps[middle + lag] + taps[middle - lag]
            total += both * characteristic[np.minimum(at, characteristic.size - 1)]
    return np.interp(np.arange(most + 1), orders, 0.5 * total)
