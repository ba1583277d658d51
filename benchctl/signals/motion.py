"""The table's motion from its encoder: band-limited, with known noise.

Two filters of `rate` are mixed: a narrow one, which passes little noise, wherever its result agrees with that of a wide
one to within noise, and the wide one during sudden motion. Ripple that repeats with the angle is known better than from
the samples of a moment: it is subtracted before the filters, and its exact derivative is added after them.

If a table moves faster than any filter of the rate passes, that fast motion is hardly known: the wide filter then gives
the complete motion, which is as accurate as usual up to the edge of the narrow one.
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
"""Power of the rate, over that of the encoder's noise between the two filters, below which the table is at rest."""

_BEGIN, _FULL = 4.0, 8.0
"""Power of the difference between wide and narrow, over its median, where mixing begins and where it is complete.

Noise must not reach it: it would select the rows in which it happens to agree with the motion.
"""

_AROUND_S = 0.3
"""Sudden motion begins this long before it exceeds the noise, and ends this long after."""
_ROUNDING_DPS = 1e-6
"""Smallest rate that is due to an encoder's noise; below it there is only rounding error, of an encoder at rest."""

_BEYOND = 0.01
"""Share of the rate (rms) outside the wide filter's band above which the motion counts as exceeding the band.

An encoder's noise is a thousandth of a table's motion; the steps of a stepper are a tenth of a shaft's.
"""

_TURNING_DPS = 1.0
"""Rms of the rate below which a table rests or creeps; everything outside the band is then encoder noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Angle [deg, unwrapped], rate [deg/s] and acceleration [deg/s²] of the table, each of shape (n,).

    `sudden`, 0 to 1, is the share of the wide filter; `filters` are the kernels (narrow, wide) that give a rate from
    angles by convolution; `ripple` bypassed them.
    """

    angle_deg: FloatArray
    rate_dps: FloatArray
    acceleration_dps2: FloatArray
    sudden: FloatArray
    filters: tuple[FloatArray, FloatArray]
    ripple: Ripple


def rates_of(motions: Sequence[Motion], angles_deg: Sequence[FloatArray]) -> list[FloatArray]:
    """Apply the filters of motions, all of one sample rate, to other angles of the same samples."""
    narrow, wide = motions[0].filters
    rates = filtered_each(angles_deg, narrow)
    mixed = [i for i, motion in enumerate(motions) if motion.sudden.any()]
    for i, rate in zip(mixed, filtered_each([angles_deg[i] for i in mixed], wide) if mixed else (), strict=True):
        rates[i] += motions[i].sudden * (rate - rates[i])
    return rates


def table_motions(angles_deg: Sequence[FloatArray], sample_rate_hz: float) -> tuple[tuple[Motion, ...], bool]:
    """Return the motion of each stretch of a recording's unwrapped angles, with the ripple that they show.

    Also return whether the table moves beyond the band of every filter: then only the wide one is used.
    """
    if _goes_beyond(angles_deg, sample_rate_hz):
        return tuple(_wide(angle, sample_rate_hz) for angle in angles_deg), True
    return motions_of(angles_deg, sample_rate_hz, ripple_of(angles_deg, sample_rate_hz)), False


def motion_of(angle_deg: FloatArray, sample_rate_hz: float, ripple: Ripple = NO_RIPPLE) -> Motion:
    """Return the motion from equidistant, unwrapped angles of an encoder, shape (n,), one stretch without gaps.

    `ripple` is the known part that repeats with the angle: θ = φ + ripple(θ), and φ is filtered; with a lag, it is
    that of the angle a moment before.
    """
    return motions_of([angle_deg], sample_rate_hz, ripple)[0]


def motions_of(
    angles_deg: Sequence[FloatArray], sample_rate_hz: float, ripple: Ripple = NO_RIPPLE
) -> tuple[Motion, ...]:
    """Return the motions of several stretches, each filtered separately."""
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
    """Return the motion of a stretch from the wide filter alone."""
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
    """Return whether unwrapped angles, an array per stretch, contain motion or noise that no rate filter passes."""
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
    """Average rates over a second wherever the table does not turn, shape (n,).

    At rest a rate contains only the encoder's noise, and a dead zone, which blocks it, would seem to fit.
    """
    window = max(3, int(_LEVEL_S * 2 * sample_rate_hz))
    power = uniform_filter1d(rate_dps**2, window)
    resting = (power < _RESTING * noise).astype(np.float64)
    resting = (uniform_filter1d(resting, 2 * window) > 1.0 - 1e-9).astype(np.float64)
    second = max(3, int(sample_rate_hz))
    averaged = uniform_filter1d(rate_dps * resting, second) / np.maximum(uniform_filter1d(resting, second), 1e-9)
    return np.asarray(np.where(resting > 0.0, averaged, rate_dps))


def _sudden(difference: FloatArray, sample_rate_hz: float) -> FloatArray:
    """Return where the wide filter passes more than noise beyond the narrow one, 0 to 1, shape (n,)."""
    power = uniform_filter1d(difference**2, max(3, int(_LEVEL_S * sample_rate_hz)))
    usual = max(float(np.median(power)), _ROUNDING_DPS**2)
    around = maximum_filter1d(power, 2 * int(_AROUND_S * sample_rate_hz) + 1)
    share = np.clip((around / usual - _BEGIN) / (_FULL - _BEGIN), 0.0, 1.0)
    smooth: FloatArray = uniform_filter1d(share, max(3, int(_LEVEL_S / 2 * sample_rate_hz)))
    return smooth
