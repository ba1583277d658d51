"""The table's motion from its encoder: band-limited, with the noise that it brings known.

Two filters of `rate` are mixed: a narrow one, which passes little noise, wherever its result agrees with that of a wide
one to within noise, and the wide one in what is sudden. Ripple that repeats with the angle is known better than from
samples of a moment: it is taken off before the filters, and its exact derivative put back behind them.

Where a table moves faster than any filter of a rate passes, next to nothing is known of it: the wide filter then makes
all of the motion, which is as good as ever up to the edge of the narrow one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from benchctl.side_by_side import shared_out
from benchctl.signals.rate import NARROW, WIDE, differentiator, edges_hz, filtered, filtered_each, half_of
from benchctl.signals.ripple import NO_RIPPLE, Ripple, ripple_of
from benchctl_instruments.arrays import FloatArray

_LEVEL_S = 0.2
_RESTING = 6.0
"""Power of the rate, in units of that of the encoder's noise between the two filters, below which the table rests."""

_BEGIN, _FULL = 4.0, 8.0
"""Power of the difference between wide and narrow, in units of its median, where mixing begins and where it is full.

Noise must not get there: rows in which it happens to agree with the motion would be those that count.
"""

_AROUND_S = 0.3
"""What is sudden begins, unseen in noise, so much before it is seen, and ends so much after."""
_ROUNDING_DPS = 1e-6
"""No encoder's noise makes a rate as small: it is the arithmetic's own, of an encoder that stands quite still."""

_BEYOND = 0.01
"""Share of the rate, rms, beyond the wide filter's band, from which on the motion is taken to go beyond it.

An encoder's noise is a thousandth of a table's motion, steps of a stepper are a tenth of a shaft's.
"""

_TURNING_DPS = 1.0
"""Rms of the rate below which a table rests or creeps: then all that is beyond is the encoder's noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Angle [deg, unwrapped], rate [deg/s] and acceleration [deg/s²] of the table, each of shape (n,).

    `sudden`, 0 to 1, is the share of the wide filter; `filters` are the rate filters (narrow, wide), to be convolved
    with angles; `ripple` went past them.
    """

    angle_deg: FloatArray
    rate_dps: FloatArray
    acceleration_dps2: FloatArray
    sudden: FloatArray
    filters: tuple[FloatArray, FloatArray]
    ripple: Ripple


def rates_of(motions: Sequence[Motion], angles_deg: Sequence[FloatArray]) -> list[FloatArray]:
    """The rates that the filters of motions of one sample rate make of other angles of the same samples."""
    narrow, wide = motions[0].filters
    rates = filtered_each(angles_deg, narrow)
    mixed = [i for i, motion in enumerate(motions) if motion.sudden.any()]
    for i, rate in zip(mixed, filtered_each([angles_deg[i] for i in mixed], wide) if mixed else (), strict=True):
        rates[i] += motions[i].sudden * (rate - rates[i])
    return rates


def table_motions(angles_deg: Sequence[FloatArray], sample_rate_hz: float) -> tuple[tuple[Motion, ...], bool]:
    """The motions behind all of a recording's unwrapped angles, a stretch each, with the ripple that they show.

    Beside them whether the table moves beyond the band of every filter: then the wide one makes all of it.
    """
    if _goes_beyond(angles_deg, sample_rate_hz):
        return tuple(_wide(angle, sample_rate_hz) for angle in angles_deg), True
    return motions_of(angles_deg, sample_rate_hz, ripple_of(angles_deg, sample_rate_hz)), False


def motion_of(angle_deg: FloatArray, sample_rate_hz: float, ripple: Ripple = NO_RIPPLE) -> Motion:
    """The motion behind equidistant, unwrapped angles of an encoder, shape (n,), one stretch without gaps.

    `ripple` is what repeats with the angle, known from elsewhere: θ = φ + ripple(θ), and φ is what is filtered; where
    it lags, it is that of the angle a moment before.
    """
    return motions_of([angle_deg], sample_rate_hz, ripple)[0]


def motions_of(
    angles_deg: Sequence[FloatArray], sample_rate_hz: float, ripple: Ripple = NO_RIPPLE
) -> tuple[Motion, ...]:
    """The motions of several stretches, each as by itself."""
    edges = [edges_hz(band, sample_rate_hz) for band in (NARROW, WIDE)]
    kernels = [differentiator(sample_rate_hz, *edge, order) for order in (1, 0, 2) for edge in edges]
    lagging = [ripple.lagging(angle, sample_rate_hz) for angle in angles_deg]
    added = [ripple.angle_deg(angle) for angle in lagging]
    even = [angle - more for angle, more in zip(angles_deg, added, strict=True)]
    of_stretches = zip(*shared_out(lambda kernel: filtered_each(even, kernel), kernels), strict=True)

    def mixed(one: tuple[tuple[FloatArray, ...], FloatArray, FloatArray]) -> Motion:
        of_stretch, at_deg, more = one
        narrow, wide, *others = of_stretch
        smooth, turning = others[:2], others[2:]
        sudden = _sudden(wide - narrow, sample_rate_hz)
        noise = float(np.median((wide - narrow) ** 2))
        even_rate = _still(narrow + sudden * (wide - narrow), noise, sample_rate_hz)
        share = 1.0 / (1.0 - ripple.slope(at_deg))
        rate = even_rate * share
        acceleration = turning[0] + sudden * (turning[1] - turning[0])
        return Motion(
            angle_deg=smooth[0] + sudden * (smooth[1] - smooth[0]) + more,
            rate_dps=rate,
            acceleration_dps2=(acceleration + ripple.bend_per_deg(at_deg) * rate**2) * share,
            sudden=sudden,
            filters=(kernels[0], kernels[1]),
            ripple=ripple,
        )

    return tuple(shared_out(mixed, zip(of_stretches, lagging, added, strict=True)))


def _wide(angle_deg: FloatArray, sample_rate_hz: float) -> Motion:
    """The motion of a stretch by the wide filter alone."""
    narrow, wide = (edges_hz(band, sample_rate_hz) for band in (NARROW, WIDE))
    angle, rate, acceleration = (
        filtered(angle_deg, differentiator(sample_rate_hz, *wide, order)) for order in range(3)
    )
    return Motion(
        angle_deg=angle,
        rate_dps=rate,
        acceleration_dps2=acceleration,
        sudden=np.ones_like(angle),
        filters=(differentiator(sample_rate_hz, *narrow, 1), differentiator(sample_rate_hz, *wide, 1)),
        ripple=NO_RIPPLE,
    )


def _goes_beyond(angles_deg: Sequence[FloatArray], sample_rate_hz: float) -> bool:
    """Whether unwrapped angles, a stretch each, hold motion or noise that no filter of the rate passes."""
    smooth, turning = (differentiator(sample_rate_hz, *edges_hz(WIDE, sample_rate_hz), order) for order in (0, 1))
    half = half_of(sample_rate_hz)
    inside = beyond = count = 0.0
    for angle in angles_deg:
        if angle.size <= 4 * half:
            continue
        left = np.diff(angle - filtered(angle, smooth)) * sample_rate_hz
        inside += float(np.sum(filtered(angle, turning)[half:-half] ** 2))
        beyond += float(np.sum(left[half:-half] ** 2))
        count += angle.size - 2 * half
    return inside > _TURNING_DPS**2 * count and math.sqrt(beyond) > _BEYOND * math.sqrt(inside)


def _still(rate_dps: FloatArray, noise: float, sample_rate_hz: float) -> FloatArray:
    """Rates averaged over a second wherever the table does not turn, shape (n,).

    At rest the encoder's noise is all that a rate holds, and a dead zone, which passes none of it, would seem to fit.
    """
    window = max(3, int(_LEVEL_S * 2 * sample_rate_hz))
    power = uniform_filter1d(rate_dps**2, window)
    resting = (power < _RESTING * noise).astype(np.float64)
    resting = (uniform_filter1d(resting, 2 * window) > 1.0 - 1e-9).astype(np.float64)
    second = max(3, int(sample_rate_hz))
    averaged = uniform_filter1d(rate_dps * resting, second) / np.maximum(uniform_filter1d(resting, second), 1e-9)
    return np.asarray(np.where(resting > 0.0, averaged, rate_dps))


def _sudden(difference: FloatArray, sample_rate_hz: float) -> FloatArray:
    """Where the wide filter sees more than noise beyond the narrow one, 0 to 1, shape (n,)."""
    power = uniform_filter1d(difference**2, max(3, int(_LEVEL_S * sample_rate_hz)))
    usual = max(float(np.median(power)), _ROUNDING_DPS**2)
    around = maximum_filter1d(power, 2 * int(_AROUND_S * sample_rate_hz) + 1)
    share = np.clip((around / usual - _BEGIN) / (_FULL - _BEGIN), 0.0, 1.0)
    smooth: FloatArray = uniform_filter1d(share, max(3, int(_LEVEL_S / 2 * sample_rate_hz)))
    return smooth
