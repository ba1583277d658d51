"""Scan over all frequencies of a line of constant amplitude in the residual, independent of the table's motion."""

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
"""Maximum offset, as a share of an interval, of a stretch from the first one's grid before a finer grid is used."""

_BANDS = 64
_TRIED = 8
_CHANCE = 1e-3
FAINTEST = 0.02
"""Minimum rms of a line relative to the noise; a smaller one may be the encoder's steps, repeated with the motion."""
_UNEVEN = 0.1
"""A line counts as one line if its parts disagree by less than this share of its gain, however small their errors."""
_HARMONICS = 50.5
"""Highest multiple of a swing's frequency that its motion can contain; backlash, for example, decreases as 1/n²."""
_SWING = 8.0 / math.pi**2
"""Share of the rate's power in one line above which a table swings at one frequency: that of alternating rates."""


def swing_hz(rate_dps: FloatArray, time_s: FloatArray, interval_s: float) -> float:
    """Return the frequency [Hz] at which a table swings, from a rate of shape (n,); 0 if there is no single one."""
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
    """Return the frequencies [Hz] of the strongest lines, up to half the sampling rate, the most promising first.

    `time_s` (n,) has a continuous phase; rows are `interval_s` apart except at gaps; `group` (n,) is the kind of motion
    of each row. A line present in only one kind belongs to the motion and is excluded, as is a low multiple of
    `swinging_hz`, the single frequency at which the table swings (0: none). A line above half the sampling rate is
    reported at its alias: the samples do not show which alias is correct, and the mains frequency is not stable enough
    to identify it as one of its harmonics.
    """
    frequency, gain, level = _periodogram(pull, time_s, interval_s)
    honest = np.where(frequency >= lowest_hz, gain / np.maximum(level, 1.0), 0.0)
    lasts_s = math.sqrt(4.0 * math.pi * _variance(time_s, pull.information))
    width = max(0.5 * lasts_s / interval_s, 2.0)
    # rate at which a periodogram crosses a level by chance at any frequency, not only on the grid (Baluev, 2008)
    places = width * math.sqrt(math.log(width) + 7.0)
    found: list[Place] = []
    least = FAINTEST**2 * float(np.count_nonzero(pull.rows))
    for index in peaks(honest, _TRIED, max(2, math.ceil(3.0 / (frequency[1] * max(lasts_s, interval_s))))):
        value = float(between(honest, index) * frequency[1])
        if 0.0 < value < _HARMONICS * swinging_hz and abs(math.remainder(value, swinging_hz)) * lasts_s < 1.0:
            continue
        if gain[index] > least and 0.0 < value <= 0.5 / interval_s and _is_one_line(pull, time_s, group, value):
            found.append(Place(value, float(gain[index]), paid(places, float(gain[index]), float(level[index]))))
        if len(found) == count:
            break
    return found


def _periodogram(pull: Pull, time_s: FloatArray, interval_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return frequencies [Hz], the gain at each, and the gain's level over that of white noise; shape (m,) each.

    Only the first four million intervals, half a day, are used; the fit refines the frequency.
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
    bands = power[: kept // band * band].reshape(-1, band)
    level = np.median(bands, axis=1) / (2.0 * math.log(2.0))
    here = np.interp(np.arange(kept), (np.arange(level.size) + 0.5) * band, level)
    return frequency, np.asarray(power), np.asarray(here)


def _passed(pull: Pull, cycles: FloatArray) -> FloatArray:
    """Return the power that the whitening leaves of a wave of so many cycles per sample, shape (m,)."""
    impulse = np.zeros(1 << 18)
    impulse[0] = 1.0
    response = unweighted(pull.whitener, impulse)
    if np.array_equal(response, impulse):
        return np.ones_like(cycles)
    gain = np.abs(scipy.fft.rfft(response)) ** 2
    return np.asarray(np.maximum(np.interp(cycles * impulse.size, np.arange(gain.size), gain), 1e-12))


def _is_one_line(pull: Pull, time_s: FloatArray, group: IntArray, frequency_hz: float) -> bool:
    """Return whether a line has the same amplitude and phase in all kinds of motion, within chance."""
    phase = 2.0 * np.pi * frequency_hz * time_s
    cosine, sine = np.cos(phase), np.sin(phase)

    def summed(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(group, values))

    # near half the sampling rate a line beats: a short motion may contain more of its cosine than of its sine
    both = summed(pull.information * cosine * sine)
    squares = summed(pull.information * cosine**2), summed(pull.information * sine**2)
    power = np.stack([np.stack([squares[0], both], -1), np.stack([both, squares[1]], -1)], -2)
    products = np.stack([summed(pull.pull * cosine), summed(pull.pull * sine)], -1)
    together = _explained(power.sum(axis=0), products.sum(axis=0))
    present = np.flatnonzero(squares[0] + squares[1] > 0.0)
    apart = sum(_explained(power[i], products[i]) for i in present.tolist()) - together
    chance = float(chdtri(2 * (present.size - 1), _CHANCE)) if present.size > 1 else math.inf
    return apart < max(chance, _UNEVEN * together)


def _explained(power: FloatArray, products: FloatArray) -> float:
    """Return the gain of a cosine and a sine with Gram matrix `power` (2, 2) and residual products `products` (2,)."""
    return float(products @ inverse(power) @ products)


def _variance(time_s: FloatArray, weight: FloatArray) -> float:
    mean = float(np.average(time_s, weights=weight))
    return float(np.average((time_s - mean) ** 2, weights=weight))
