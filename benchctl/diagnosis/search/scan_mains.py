"""Every frequency at once: a line of constant amplitude in the residual, whatever the table does."""

from __future__ import annotations

import math

import numpy as np
import scipy.fft
from scipy.special import chdtri

from benchctl.diagnosis.search.pull import Place, Pull, between, paid, peaks, unweighted
from benchctl.estimation.fit import inverse
from benchctl_instruments.arrays import FloatArray, IntArray

_LONGEST = 1 << 22
_FINE = 4
_OFF_GRID = 0.05
"""Share of an interval by which a stretch may lie off the first one's grid before the grid is made finer."""

_BANDS = 64
_TRIED = 8
_CHANCE = 1e-3
FAINTEST = 0.02
"""Rms of a line over that of the noise, below which it may be the encoder's steps, which repeat with the motion."""
_UNEVEN = 0.1
"""A line whose parts disagree by less than this share of its gain is one line, however well each of them is known."""
_HARMONICS = 50.5
"""Multiples of a swing's frequency beyond which nothing is left of its motion: that of a backlash falls as 1/n²."""
_SWING = 0.7
"""Share of a rate's power in one line, from which on a table swings at one frequency."""


def swing_hz(rate_dps: FloatArray, time_s: FloatArray, interval_s: float) -> float:
    """The one frequency [Hz] at which a table swings, from a rate of shape (n,); 0 where there is no such."""
    place = np.rint((time_s - time_s.min()) / interval_s).astype(np.int64)
    if place.max() >= _LONGEST:
        return 0.0
    size = scipy.fft.next_fast_len(2 * int(place.max() + 1), real=True)
    strength = np.abs(scipy.fft.rfft(np.bincount(place, rate_dps), size))
    frequency = float(np.argmax(strength)) / (size * interval_s)
    share = 2.0 * float(strength.max()) ** 2 / (rate_dps.size * max(float(rate_dps @ rate_dps), 1e-300))
    return frequency if share > _SWING else 0.0


def mains_places(
    pull: Pull,
    time_s: FloatArray,
    interval_s: float,
    group: IntArray,
    lowest_hz: float,
    count: int,
    swinging_hz: float = 0.0,
) -> list[Place]:
    """The frequencies [Hz] of the strongest lines, up to half the sampling rate, the most promising first.

    `time_s` (n,) has one phase all along; rows are `interval_s` apart but for gaps; `group` (n,) are rows of one kind
    of motion: a line that only one of them has is the motion's own, and so is a low multiple of `swinging_hz`, the one
    frequency at which the table swings (0: there is none). A line above half the sampling rate stands at its alias, and
    is reported there: the samples hold nothing that tells which of its aliases is meant, and the mains are never so
    exact that a match with one of their harmonics would.
    """
    frequency, gain, level = _periodogram(pull, time_s, interval_s)
    honest = np.where(frequency >= lowest_hz, gain / np.maximum(level, 1.0), 0.0)
    lasts_s = math.sqrt(4.0 * math.pi * _variance(time_s, pull.information))
    width = max(0.5 * lasts_s / interval_s, 2.0)
    # how often a periodogram, at any frequency and not only at whole ones, crosses a level by chance (Baluev, 2008)
    places = width * math.sqrt(math.log(width) + 7.0)
    found: list[Place] = []
    least = FAINTEST**2 * float(np.count_nonzero(pull.rows))
    for index in peaks(honest, _TRIED, max(2, math.ceil(3.0 / (frequency[1] * max(lasts_s, interval_s))))):
        value = float(between(honest, index) * frequency[1])
        if value < _HARMONICS * swinging_hz and abs(math.remainder(value, swinging_hz)) * lasts_s < 1.0:
            continue
        if gain[index] > least and 0.0 < value <= 0.5 / interval_s and _is_one_line(pull, time_s, group, value):
            found.append(Place(value, float(gain[index]), paid(places, float(gain[index]), float(level[index]))))
        if len(found) == count:
            break
    return found


def _periodogram(pull: Pull, time_s: FloatArray, interval_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Frequencies [Hz], the gain at each, and the gain's level over that of white noise; shape (m,) each.

    Beyond four million intervals, half a day, a line is found by what came before and refined by the fit.
    """
    since = (time_s - time_s.min()) / interval_s
    near = since < _LONGEST
    aligned = float(np.max(np.abs(since[near] - np.rint(since[near])))) < _OFF_GRID
    fine = 1 if aligned or float(since[near].max()) * _FINE > _LONGEST else _FINE
    place = np.rint(since[near] * fine).astype(np.int64)
    sums = np.bincount(place, pull.pull[near])
    size = scipy.fft.next_fast_len(2 * sums.size, real=True)
    kept = size // (2 * fine) + 1
    frequency = np.arange(kept, dtype=np.float64) * (fine / (size * interval_s))
    power = np.abs(scipy.fft.rfft(sums, size)[:kept]) ** 2
    power /= 0.5 * float(pull.information[near].sum()) * _passed(pull, frequency * interval_s)
    band = max(16, kept // _BANDS)
    whole = power[: kept // band * band].reshape(-1, band)
    level = np.median(whole, axis=1) / (2.0 * math.log(2.0))
    here = np.interp(np.arange(kept), (np.arange(level.size) + 0.5) * band, level)
    return frequency, np.asarray(power), np.asarray(here)


def _passed(pull: Pull, cycles: FloatArray) -> FloatArray:
    """The power that the whitening leaves of a wave of so many cycles a sample, shape (m,)."""
    impulse = np.zeros(1 << 18)
    impulse[0] = 1.0
    response = unweighted(pull.whitener, impulse)
    if np.array_equal(response, impulse):
        return np.ones_like(cycles)
    gain = np.abs(scipy.fft.rfft(response)) ** 2
    return np.asarray(np.maximum(np.interp(cycles * impulse.size, np.arange(gain.size), gain), 1e-12))


def _is_one_line(pull: Pull, time_s: FloatArray, group: IntArray, frequency_hz: float) -> bool:
    """Whether all kinds of motion say the same of a line, to within chance."""
    phase = 2.0 * np.pi * frequency_hz * time_s
    cosine, sine = np.cos(phase), np.sin(phase)

    def summed(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(group, values))

    # near half the sampling rate a line beats: a short kind of motion may see more of its cosine than of its sine
    both = summed(pull.information * cosine * sine)
    squares = summed(pull.information * cosine**2), summed(pull.information * sine**2)
    power = np.stack([np.stack([squares[0], both], -1), np.stack([both, squares[1]], -1)], -2)
    seen = np.stack([summed(pull.pull * cosine), summed(pull.pull * sine)], -1)
    together = _explained(power.sum(axis=0), seen.sum(axis=0))
    there = np.flatnonzero(squares[0] + squares[1] > 0.0)
    apart = sum(_explained(power[i], seen[i]) for i in there.tolist()) - together
    chance = float(chdtri(2 * (there.size - 1), _CHANCE)) if there.size > 1 else math.inf
    return apart < max(chance, _UNEVEN * together)


def _explained(power: FloatArray, seen: FloatArray) -> float:
    """The gain of a cosine and a sine with products `power` (2, 2) that were `seen` (2,)."""
    return float(seen @ inverse(power) @ seen)


def _variance(time_s: FloatArray, weight: FloatArray) -> float:
    mean = float(np.average(time_s, weights=weight))
    return float(np.average((time_s - mean) ** 2, weights=weight))
