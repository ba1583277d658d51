"""Scale factor and delay from one long run in any motion, in angle: integrated gyro against encoder, within a band.

Gyro g(t) = K·ω(t − τ), so that the angle is θ(t) = ∫g dt (t + τ)/K. Both angles pass the same zero-phase band-pass,
which removes the bias (below) and the encoder's resolution noise (above). The integral uses a spline: a sum of samples
is late by half a sample, which would appear as a wrong delay; trapezoids have no delay, but lose (ω·dt)²/12 of the
amplitude. In angle the encoder's quantisation is white noise; differentiated it would attenuate the scale factor.
Intervals are computed from blocks of time, because the residuals are correlated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from benchctl.calibration.uncertainty import coverage_factor
from benchctl.estimation.linear import clustered_covariance
from benchctl.recordings.model import Step
from benchctl.recordings.runs import gaps
from benchctl.signals.rate import unwrap_deg
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

BAND_HZ = (0.02, 10.0)
CLUSTER_S = 60.0
_LEAST_MOTION_DEG = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeMotionFit:
    """Scale factor (output per °/s) and delay with 95 % intervals; rms angle residual before and after, deg.

    `before_deg` is for `start_scale`, or else the fitted scale, and no delay.
    """

    scale: float
    scale_ci95: tuple[float, float]
    delay_s: float
    delay_ci95: tuple[float, float]
    before_deg: float
    after_deg: float
    band_hz: tuple[float, float]
    clusters: int


def fit_free_motion(
    angle_deg: FloatArray,
    output: FloatArray,
    sample_rate_hz: float,
    *,
    start_scale: float | None = 1.0,
    band_hz: tuple[float, float] = BAND_HZ,
) -> FreeMotionFit:
    """Fit one scan; `angle_deg` unwrapped and `output` are equidistant samples, shape (n,), without gaps.

    `start_scale` is the scale assumed before the fit (1 for a gyro that outputs °/s), None if unknown.
    """
    from scipy.signal import butter, sosfiltfilt  # takes half a second to import; no other fit needs it

    low, high = band_hz
    clusters = int(angle_deg.size / sample_rate_hz / CLUSTER_S)
    if clusters < 5 or not 0 < low < high < sample_rate_hz / 2:
        raise UsageError(
            f"free motion: {angle_deg.size / sample_rate_hz:.0f} s at {sample_rate_hz:g} Hz, expected at least "
            f"{5 * CLUSTER_S:g} s and a band inside 0 … {sample_rate_hz / 2:g} Hz (it is {low:g} … {high:g} Hz)"
        )
    passing = butter(2, band_hz, btype="bandpass", fs=sample_rate_hz, output="sos")

    def band(values: FloatArray) -> FloatArray:
        return np.asarray(sosfiltfilt(passing, values - values.mean()))

    time = np.arange(angle_deg.size) / sample_rate_hz
    turned = np.asarray(CubicSpline(time, output - output.mean()).antiderivative()(time))
    angle, rate = band(angle_deg - angle_deg[0]), band(output)
    if float(angle.std()) < _LEAST_MOTION_DEG:
        raise UsageError(
            f"free motion: the angle moves by {angle.std():.2g}° rms only, expected {_LEAST_MOTION_DEG:g}° or more"
        )
    spline, rate_spline = CubicSpline(time, band(turned)), CubicSpline(time, rate)
    # The filter's ends ring for a few periods of its lower edge.
    margin = int(min(2.0 / low, time[-1] / 10) * sample_rate_hz)
    inside = slice(margin, angle.size - margin)
    delay = 0.0
    for _ in range(6):
        columns = np.stack([spline(time + delay), rate_spline(time + delay)], axis=1)[inside]
        coefficients = np.linalg.lstsq(columns, angle[inside], rcond=None)[0]
        change = float(coefficients[1] / coefficients[0])
        delay += change
        if abs(change) < 1e-9:
            break
    residual = angle - spline(time + delay) * coefficients[0]
    cluster = (np.arange(columns.shape[0]) * clusters // columns.shape[0]).astype(np.int64)
    covariance, dof = clustered_covariance(columns, residual[inside], cluster)
    scale = 1.0 / float(coefficients[0])
    factors = np.array([coverage_factor(each, 0.95) for each in dof.tolist()])
    widths = factors * np.sqrt(np.diag(covariance)) * np.array([scale**2, abs(scale)])
    return FreeMotionFit(
        scale=scale,
        scale_ci95=(scale - float(widths[0]), scale + float(widths[0])),
        delay_s=delay,
        delay_ci95=(delay - float(widths[1]), delay + float(widths[1])),
        before_deg=float(np.std((angle - spline(time) / (start_scale or scale))[inside])),
        after_deg=float(np.std(residual[inside])),
        band_hz=band_hz,
        clusters=clusters,
    )


def fit_free_motion_of(step: Step, start_scale: float | None) -> FreeMotionFit:
    """Fit a step of a recording; raise `UsageError` if it is too short, lacks a channel, or has gaps."""
    if missing := [name for name in ("time_s", "encoder_deg", "gyro_v") if name not in step.channels]:
        raise UsageError(f"free motion: the step has no {', '.join(missing)}, which such a fit needs")
    time, angle, output = step["time_s"], step["encoder_deg"], step["gyro_v"]
    interval = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    unbroken = interval > 0.0 and not gaps(np.diff(time), interval).any()
    if not (unbroken and np.all(np.isfinite(angle) & np.isfinite(output))):
        raise UsageError("free motion: the samples have gaps, expected an unbroken run")
    return fit_free_motion(unwrap_deg(angle), output, 1.0 / interval, start_scale=start_scale)
