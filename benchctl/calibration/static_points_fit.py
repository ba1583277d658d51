"""Straight line against sine law on a table of static points: what one can say without an encoder.

The points are means at commanded rates. Misfits are root mean squares of the residual rate, in °/s and in percent of
full scale (the largest rate). The intervals are by the scatter about the sine. The point at rest may be under another
influence than the rotating ones (slip rings, cables), so every fit is done with and without it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.special import stdtrit

from instruments.errors import UsageError, in_line

FloatArray = npt.NDArray[np.float64]

_FEWEST = 5
_START_S = 3e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Misfit:
    """Root mean square and largest residual of a law: °/s, and rms in percent of the largest rate."""

    rms_dps: float
    largest_dps: float
    rms_percent_fs: float
    largest_percent_fs: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PointsFit:
    """Line U = U0 + K0·ω and sine U = U0 + (K0/S)·sin(S·ω) on the same points; 95 % intervals of the sine's.

    `residual_line_dps` and `residual_sine_dps` are of all points, those left out too, shape (n,).
    """

    points: int
    full_scale_dps: float
    line: Misfit
    sine: Misfit
    line_K0_v_per_dps: float  # noqa: N815 - K0 and U0 are the field's own letters
    line_U0_v: float  # noqa: N815 - as above
    K0_v_per_dps: float
    K0_ci95: tuple[float, float]
    U0_v: float
    U0_ci95: tuple[float, float]
    S_rad_per_dps: float
    S_ci95: tuple[float, float]
    residual_line_dps: FloatArray
    residual_sine_dps: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class StaticPointsResult:
    """Fits of the rotating points alone (`rotating`) and with rest (`all_points`), and what the points at rest do.

    `rest_offset_v` is the mean of the points at rest less the sine through the rotating ones at zero rate,
    `rest_offset_dps` the same as a rate; `rest_std_v` and `rotating_std_v` the mean standard deviations stated with the
    points, NaN where none are. Without points at rest the offsets are NaN and `all_points` equals `rotating`.
    """

    rotating: PointsFit
    all_points: PointsFit
    rest_points: int
    rest_offset_v: float
    rest_offset_dps: float
    rest_std_v: float
    rotating_std_v: float
    says: str


def fit_static_points(rate_dps: FloatArray, mean_v: FloatArray, std_v: FloatArray | None = None) -> StaticPointsResult:
    """Fit both laws to points of shape (n,). Raises `UsageError` where there are too few rates."""
    if rate_dps.size != mean_v.size or not (np.all(np.isfinite(rate_dps)) and np.all(np.isfinite(mean_v))):
        raise UsageError(
            f"static points: expected as many finite outputs as rates, got {mean_v.size} and {rate_dps.size}; "
            "leave out what was not measured"
        )
    rotating = np.abs(rate_dps) > 1e-3
    if np.unique(rate_dps[rotating]).size < _FEWEST:
        raise UsageError(
            f"static points: {np.unique(rate_dps[rotating]).size} different rates other than rest, expected at least "
            f"{_FEWEST} to tell a line from a sine; measure more rates"
        )
    alone = _fit(rate_dps, mean_v, rotating)
    together = _fit(rate_dps, mean_v, np.ones_like(rotating))
    rest = ~rotating
    offset = float(np.mean(mean_v[rest])) - alone.U0_v if rest.any() else float("nan")
    stds = np.full(rate_dps.shape, np.nan) if std_v is None else std_v
    rest_std = float(np.mean(stds[rest])) if rest.any() else float("nan")
    says = "There is no point at rest."
    if rest.any():
        says = (
            f"The {int(rest.sum())} points at rest lie {offset / alone.K0_v_per_dps:+.2f} °/s off the "
            "sine through the rotating "
            f"points; with them the sine's misfit is {together.sine.rms_dps:.3f} °/s instead of "
            f"{alone.sine.rms_dps:.3f} °/s, "
            f"and S {together.S_rad_per_dps:.5f} instead of {alone.S_rad_per_dps:.5f} rad/(°/s)."
        )
    return StaticPointsResult(
        rotating=alone,
        all_points=together,
        rest_points=int(rest.sum()),
        rest_offset_v=offset,
        rest_offset_dps=offset / alone.K0_v_per_dps,
        rest_std_v=rest_std,
        rotating_std_v=float(np.mean(stds[rotating])),
        says=says,
    )


def _fit(rate: FloatArray, mean: FloatArray, use: npt.NDArray[np.bool_]) -> PointsFit:
    """Both laws through the points in use, residuals of all."""
    x, y = rate[use], mean[use]
    slope, offset = np.polyfit(x, y, 1)

    def sine(parameters: FloatArray, at: FloatArray) -> FloatArray:
        K0, U0, S = parameters
        return np.asarray(U0 + K0 * at * np.sinc(S * at / np.pi))

    start = np.array([slope, offset, _START_S])

    def misfit(parameters: FloatArray) -> FloatArray:
        return np.asarray(sine(parameters, x) - y)

    found = least_squares(misfit, start, x_scale=[abs(slope), abs(slope), 1e-3], xtol=1e-14, ftol=1e-14)
    if not found.success:
        raise UsageError(
            f"static points: the sine law does not fit: {in_line(found.message)}; look for a point that is off"
        )
    K0, U0, S = found.x
    S = abs(S)
    freedom = x.size - 3
    jacobian = np.asarray(found.jac, dtype=np.float64)
    covariance = np.linalg.inv(jacobian.T @ jacobian) * 2 * found.cost / freedom
    half = stdtrit(freedom, 0.975) * np.sqrt(np.diag(covariance))
    indicated = (mean - U0) / K0
    # Beyond the sine's reach the residual is taken along its slope at low rates.
    residual_sine = np.where(
        np.abs(S * indicated) <= 1,
        np.arcsin(np.clip(S * indicated, -1, 1)) / S - rate,
        (mean - sine(found.x, rate)) / K0,
    )
    residual_line = (mean - offset) / slope - rate
    scale = float(np.max(np.abs(rate)))
    return PointsFit(
        points=int(use.sum()),
        full_scale_dps=scale,
        line=_misfit(residual_line[use], scale),
        sine=_misfit(residual_sine[use], scale),
        line_K0_v_per_dps=float(slope),
        line_U0_v=float(offset),
        K0_v_per_dps=float(K0),
        K0_ci95=(float(K0 - half[0]), float(K0 + half[0])),
        U0_v=float(U0),
        U0_ci95=(float(U0 - half[1]), float(U0 + half[1])),
        S_rad_per_dps=float(S),
        S_ci95=(float(S - half[2]), float(S + half[2])),
        residual_line_dps=residual_line,
        residual_sine_dps=residual_sine,
    )


def _misfit(residual: FloatArray, full_scale: float) -> Misfit:
    rms, largest = float(np.sqrt(np.mean(residual**2))), float(np.max(np.abs(residual)))
    return Misfit(
        rms_dps=rms,
        largest_dps=largest,
        rms_percent_fs=100 * rms / full_scale,
        largest_percent_fs=100 * largest / full_scale,
    )
