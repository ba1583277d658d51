"""Every number of lines at once: an error of the encoder that repeats from line to line of its grating.

Such an error e(θ) changes the prediction by −∂U/∂ω·F(e), with the filter F that makes rates of angles. So the residual
pulls at the angles by the transpose of that, and at sin(N·θ), cos(N·θ) by one Fourier transform over the turn.
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
"""Fewer lines to a turn are an encoder's eccentricity and its like."""

_NUDGE_DPS = 1e-3
_STEP_RAD = 1e-6
"""Turns from row to row are told apart to so much: at 100 000 lines that is a sixtieth of a period."""

_EVERY = 8
_PADDED = 8
_APART = 20
"""Where little of a turn is covered, numbers of lines next to each other are one."""


def line_places(problem: GyroProblem, pull: Pull, most: int, count: int) -> list[Place]:
    """The whole numbers of lines a turn whose waves promise most, up to `most`, the most promising first."""
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
    """Pull and information at the rows of the frame, of which a problem may have kept some."""
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
    """∂U/∂ω of the fitted model, shape (n,)."""
    frame, law = problem.frame, problem.chain.law
    more, less = (
        law.volts(pull.fitted.point.baseline, frame.rate_dps + nudge, frame.temp_c)
        for nudge in (_NUDGE_DPS, -_NUDGE_DPS)
    )
    return np.asarray((more - less) / (2.0 * _NUDGE_DPS))


def _powers(problem: GyroProblem, weight: FloatArray, most: int) -> FloatArray:
    """Half of Σ weight·|gain|² of waves of amplitude one, for every number of lines up to `most`, shape (most+1,).

    At each row the wave has, for as long as the filter is, the frequency that its rate gives it, folded at half the
    sampling rate or not. The squared gain is a cosine series in that phase from row to row, whose coefficients are the
    correlation of the filters' taps; so all that is needed is the characteristic function of the rows' turns.
    """
    frame = problem.frame
    kernels = frame.motions[0].filters
    if problem.band is not None:
        kernels = (np.convolve(kernels[0], _slow(problem)), np.convolve(kernels[1], _slow(problem)))
    place = np.floor(np.abs(np.radians(frame.rate_dps)) * frame.interval_s / _STEP_RAD).astype(np.int64)
    bins = int(place.max()) + 1
    size = scipy.fft.next_fast_len(_PADDED * bins, real=True)
    orders = np.append(np.arange(0, most, _EVERY), most)
    share = frame.sudden
    total = np.zeros(orders.size)
    for mixed, a, b in ((1.0 - share) ** 2, 0, 0), (2.0 * share * (1.0 - share), 0, 1), (share**2, 1, 1):
        turned = scipy.fft.rfft(np.bincount(place, weight * mixed, minlength=bins), size)
        # beyond the last turns are no longer told apart: their waves have every phase
        characteristic = np.append((turned * np.exp(-1j * np.pi / size * np.arange(turned.size))).real, 0.0)
        taps = np.correlate(kernels[a], kernels[b], "full")
        middle = taps.size // 2
        total += taps[middle] * characteristic[0]
        for lag in range(1, middle + 1):
            at = np.rint(orders * (lag * _STEP_RAD * size / (2.0 * np.pi))).astype(np.int64)
            both = taps[middle + lag] + taps[middle - lag]
            total += both * characteristic[np.minimum(at, characteristic.size - 1)]
    return np.interp(np.arange(most + 1), orders, 0.5 * total)
