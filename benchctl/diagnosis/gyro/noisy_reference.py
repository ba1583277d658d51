"""Noise of the reference: an encoder's rate that is not coherent with the gyro beyond the band of the motion.

A rate that a controller computes from few encoder steps, and from which the angle was summed up again, has noise at all
frequencies. Any low-pass of such a reference reduces the residual, whatever the gyro does (errors in variables): a
bandwidth would be found, with a lead that cancels its delay. With the reference expected for the measured one, its
Wiener estimate, the least residual is that of the gyro's true response (regression calibration: Carroll et al.,
Measurement error in nonlinear models, 2nd ed. 2006, ch. 4). That estimate is nearly the reference without what lies
beyond the band of the motion, because the spectrum of a table's motion is steep.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import firwin, kaiserord

from benchctl.diagnosis.gyro.frame import Frame
from benchctl.signals.rate import NARROW, WIDE, edges_hz, filtered_along
from benchctl.signals.windows import windows_of
from benchctl_instruments.arrays import ComplexArray, FloatArray

_LONGEST_S, _IN_LONGEST, _FEWEST_WINDOWS, _FEWEST_ROWS = 10.0, 8, 12, 16
"""Longest window; windows, without overlap, in the longest stretch; minimum number and minimum length of windows."""
_POOLED = 3
"""Number of bins whose spectra are summed for a coherence, so that few windows suffice."""
_COHERENT = 0.5
"""Coherence above which a bin contains motion."""
_OCTAVE = 2.0
"""Edge of the low-pass filter's stop band over that of its pass band."""
_OCTAVES_DOWN = 1.5
"""From the middle of the first octave beyond the stop band down to the edge of the motion."""
_NOTICEABLE = 0.25
"""Share of the output's noise at the edge of the motion above which the reference's noise counts.

In simulated recordings of some minutes a tenth did no harm, and a half led to false findings.
"""
_EVENT, _EVENTS = 10.0, 0.1
"""Ratio of a window's fast power to that of most others above which it holds an event, such as a jump of the encoder's
angle, which is no noise; share of the windows that may hold one."""
_ATTENUATION_DB = 60.0
_MOST_LOST = 0.5
"""Largest share of the rows that the filter may lose at the ends of the stretches."""


def without_noise(frame: Frame) -> Frame:
    """Return the frame with its motion low-passed to the band that the gyro confirms; itself if the noise is small."""
    noisy = None if frame.beyond else _noisy(frame)
    if noisy is None:
        return frame
    known_hz, within = noisy
    taps, beta = kaiserord(_ATTENUATION_DB, (_OCTAVE - 1.0) * known_hz * 2.0 * frame.interval_s)
    middle_hz = 0.5 * (1.0 + _OCTAVE) * known_hz
    kernel = np.asarray(firwin(taps | 1, middle_hz, window=("kaiser", beta), fs=1.0 / frame.interval_s))
    if (2 * frame.reach + kernel.size) * len(frame.stretches) > _MOST_LOST * frame.rows:
        return frame
    names = ("angle_deg", "rate_dps", "acceleration_dps2")
    smooth: dict[str, Any] = {name: filtered_along(frame.stretches, getattr(frame, name), kernel) for name in names}
    narrow, wide = (np.convolve(one, kernel) for one in frame.motions[0].filters)
    motions = tuple(
        replace(motion, filters=(narrow, wide), **{name: values[part] for name, values in smooth.items()})
        for motion, part in zip(frame.motions, frame.stretches, strict=True)
    )
    return replace(frame, motions=motions, known_hz=known_hz, noisy_within=within, **smooth)


def _noisy(frame: Frame) -> tuple[float, bool] | None:
    """Return the band of the motion, and whether the reference's noise counts within it; None if it is not noisy.

    The band ends at the highest frequency at which reference and output are coherent; at the lowest of the windows if
    there is none, as within steps of constant rates.

    The reference is noisy if its power times the squared gain, at frequencies where it should have none, is a
    noticeable share of the output's; power that the gyro confirms is motion. Compared are derivatives, in which strong
    slow motion does not hide weak noise. What counts is the share at the edge of the motion: it is extrapolated from
    the two octaves beyond twice this frequency, since white noise of an encoder's angle, of which the share grows with
    the squared frequency, does no harm there. Within steps of constant rates no motion argues against a low-pass: the
    noise beyond the band counts.
    """
    sample_rate_hz = 1.0 / frame.interval_s
    longest = max(part.stop - part.start for part in frame.stretches)
    size = 1 << int(math.log2(min(_LONGEST_S * sample_rate_hz, longest / _IN_LONGEST) + 1.0))
    if size < _FEWEST_ROWS:
        return None
    turning = np.gradient(np.gradient(frame.encoder_deg)) * sample_rate_hz
    output = np.gradient(frame.volts)
    usable = np.isfinite(output)
    if frame.filled is not None:
        usable &= ~frame.filled
    inner = [slice(part.start + 2, part.stop - 2) for part in frame.stretches if part.stop - part.start >= size + 4]
    windows = windows_of(usable, inner, size, frame.interval_s)
    if windows.starts.size < _FEWEST_WINDOWS:
        return None
    passing_hz, widest_hz = (edges_hz(band, sample_rate_hz)[0] for band in (NARROW, WIDE))
    bins = np.flatnonzero((windows.frequency_hz > 0.0) & (windows.frequency_hz <= widest_hz))
    frequency = windows.frequency_hz[bins]
    reference, measured = windows.spectra(turning, bins), windows.spectra(output, bins)
    of_reference, of_output, shared = _powers(reference, measured)
    pooled = _pooled(shared.real) ** 2 + _pooled(shared.imag) ** 2
    coherent = pooled > _COHERENT * _pooled(of_reference) * _pooled(of_output)
    moved = bool(coherent.any())
    known_hz = float(frequency[coherent].max() if moved else frequency[0])
    stop_hz = _OCTAVE * known_hz
    if moved:
        gain = float(np.abs(shared[coherent]).sum() / of_reference[coherent].sum())
    else:
        rate_dps = frame.rate_dps[usable] - frame.rate_dps[usable].mean()
        gain = abs(float(rate_dps @ frame.volts[usable])) / max(float(rate_dps @ rate_dps), 1e-300)

    fast = np.sum(np.abs(reference[:, frequency > stop_hz]) ** 2, axis=1)
    steady = fast <= _EVENT * np.quantile(fast, 1.0 - _EVENTS)
    of_reference, of_output, shared = _powers(reference[steady], measured[steady])

    def share(from_hz: float, to_hz: float) -> float:
        beyond = (frequency > from_hz) & (frequency <= to_hz)
        of_both = float(of_reference[beyond].sum()), float(of_output[beyond].sum())
        confirmed = float(np.abs(shared[beyond].sum()))  # the gyro follows true motion, however weak
        return gain * max(gain * of_both[0] - confirmed, 0.0) / of_both[1] if of_both[1] > 0.0 else 0.0

    near = share(stop_hz, min(_OCTAVE * stop_hz, passing_hz))
    far = share(_OCTAVE * stop_hz, _OCTAVE**2 * stop_hz)
    at_motion = near * min(near / far, 1.0) ** _OCTAVES_DOWN if far > 0.0 else near
    within = at_motion > _NOTICEABLE
    return (known_hz, within) if within or (not moved and share(stop_hz, passing_hz) > _NOTICEABLE) else None


def _powers(reference: ComplexArray, measured: ComplexArray) -> tuple[FloatArray, FloatArray, ComplexArray]:
    """Return the power of both, shape (bins,), and their cross spectrum, summed over windows (windows, bins)."""
    of_reference, of_output = (np.sum(np.abs(one) ** 2, axis=0) for one in (reference, measured))
    return of_reference, of_output, np.sum(reference.conj() * measured, axis=0)


def _pooled(values: FloatArray) -> FloatArray:
    return np.asarray(uniform_filter1d(values, _POOLED, mode="nearest"))
