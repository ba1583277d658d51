"""Straight line and sine law on a table of static points: what can be determined without an encoder.

The points are means at commanded rates. Misfits are root mean squares of the residual rate, in °/s and in percent of
full scale (the largest rate that is fitted). The intervals follow from the scatter about the sine. The point at rest
may be under other influences than the rotating ones (slip rings, cables), so every fit is done with and without it.
Rates at which the output has left the law (its limit, an overload) are detected from the smaller ones and not fitted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import t as student

from benchctl.calibration.uncertainty import coverage_factor
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.errors import UsageError, in_line

FEWEST_RATES = 5
"""Minimum number of rates other than rest that distinguish a line from a sine."""
RESTING_DPS = 1e-3
_PARAMETERS = 3
_START_S = 3e-3
_ROUNDING = 1e-9
_CHANCE, _LEAVES, _MOST = 1e-6, 3.0, 0.75
"""An output has left the law if its distance has a probability below one in a million, from the scatter of the points
at smaller rates, and is three times the largest of theirs; the law ends where most larger rates have left it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Misfit:
    """Root mean square and largest residual of a law, in °/s and in percent of the largest rate."""

    rms_dps: float
    largest_dps: float
    rms_percent_fs: float
    largest_percent_fs: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PointsFit:
    """Line U = U0 + K0·ω and sine U = U0 + (K0/S)·sin(S·ω) on the same points; 95 % intervals are those of the sine.

    `residual_line_dps` and `residual_sine_dps` are those of all points, including points left out, shape (n,).
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

    @property
    def dof(self) -> int:
        """Degrees of freedom of the sine law's fit."""
        return self.points - _PARAMETERS

    def output_v(self, rate_dps: FloatArray) -> FloatArray:
        """Return the sine's output [V] at rates [deg/s], both of shape (n,)."""
        return _sine(np.array([self.K0_v_per_dps, self.U0_v, self.S_rad_per_dps]), rate_dps)

    def expanded(self, ci95: tuple[float, float]) -> float:
        """Return the expanded uncertainty (95.45 %) that corresponds to a 95 % interval of this fit."""
        return 0.5 * (ci95[1] - ci95[0]) * coverage_factor(self.dof) / coverage_factor(self.dof, 0.95)


@dataclass(frozen=True, slots=True, kw_only=True)
class StaticPointsResult:
    """Fits of the rotating points alone (`rotating`) and with rest (`all_points`), and the effect of points at rest.

    `rest_offset_v` is the mean of the points at rest minus the sine through the rotating ones at zero rate,
    `rest_offset_dps` the same as a rate; `rest_std_v` and `rotating_std_v` are the mean standard deviations stated with
    the points, NaN if none are. Without points at rest the offsets are NaN and `all_points` equals `rotating`.
    Both are fits of the points up to `follows_to_dps`; `beyond` points at larger rates have left the law.
    """

    rotating: PointsFit
    all_points: PointsFit
    follows_to_dps: float
    beyond: int
    rest_points: int
    rest_offset_v: float
    rest_offset_dps: float
    rest_std_v: float
    rotating_std_v: float
    says: str


def fit_static_points(rate_dps: FloatArray, mean_v: FloatArray, std_v: FloatArray | None = None) -> StaticPointsResult:
    """Fit both laws to points of shape (n,). Raises `UsageError` if there are too few rates."""
    if rate_dps.size != mean_v.size or not (np.all(np.isfinite(rate_dps)) and np.all(np.isfinite(mean_v))):
        raise UsageError(
            f"static points: expected as many finite outputs as rates, got {mean_v.size} and {rate_dps.size}; "
            "leave out what was not measured"
        )
    rotating = np.abs(rate_dps) > RESTING_DPS
    if np.unique(rate_dps[rotating]).size < FEWEST_RATES:
        raise UsageError(
            f"static points: {np.unique(rate_dps[rotating]).size} different rates other than rest, expected at least "
            f"{FEWEST_RATES} to tell a line from a sine; measure more rates"
        )
    follows_to_dps = follows_to(rate_dps[rotating], mean_v[rotating])
    follows = np.abs(rate_dps) <= follows_to_dps
    rest, rotating = ~rotating, rotating & follows
    alone = _fit(rate_dps, mean_v, rotating)
    together = _fit(rate_dps, mean_v, follows)
    offset = float(np.mean(mean_v[rest])) - alone.U0_v if rest.any() else float("nan")
    stds = np.full(rate_dps.shape, np.nan) if std_v is None else std_v
    rest_std = float(np.mean(stds[rest])) if rest.any() else float("nan")
    summary = "There is no point at rest."
    if rest.any():
        summary = (
            f"The {int(rest.sum())} points at rest lie {offset / alone.K0_v_per_dps:+.2f} °/s off the sine through the "
            f"rotating points; with them the sine's misfit is {together.sine.rms_dps:.3f} °/s instead of "
            f"{alone.sine.rms_dps:.3f} °/s, and S {together.S_rad_per_dps:.5f} instead of {alone.S_rad_per_dps:.5f} "
            "rad/(°/s)."
        )
    if not follows.all():
        law = np.array([alone.K0_v_per_dps, alone.U0_v, alone.S_rad_per_dps])
        away_v = mean_v[~follows] - _sine(law, rate_dps[~follows])
        summary += (
            f" Beyond {follows_to_dps:g} °/s the output has left the law, by up to {float(np.abs(away_v).max()):.2g} V:"
            f" a limit, or an overload. The {int((~follows).sum())} points there are not fitted."
        )
    return StaticPointsResult(
        rotating=alone,
        all_points=together,
        follows_to_dps=follows_to_dps,
        beyond=int((~follows).sum()),
        rest_points=int(rest.sum()),
        rest_offset_v=offset,
        rest_offset_dps=offset / alone.K0_v_per_dps,
        rest_std_v=rest_std,
        rotating_std_v=float(np.mean(stds[rotating])),
        says=summary,
    )


def follows_to(rate: FloatArray, mean: FloatArray) -> float:
    """Return the rate [°/s] above which points, shape (n,), are off the sine through the others at most larger rates.

    It is the largest rate of all if they never are.
    """
    size = np.abs(rate)
    levels = np.unique(size)
    for level in levels[:-1].tolist():
        inner, outer = size <= level, size > level
        if np.unique(rate[inner]).size < FEWEST_RATES:
            continue
        found = _sine_through(rate[inner], mean[inner])
        freedom = int(inner.sum()) - _PARAMETERS
        scatter_v = math.sqrt(2.0 * found.cost / freedom)
        slopes = _slopes(found.x, rate[outer])
        of_fit = np.einsum("ij,jk,ik->i", slopes, np.linalg.pinv(found.jac.T @ found.jac), slopes)
        away_v = np.abs(_sine(found.x, rate[outer]) - mean[outer])
        chance = 2.0 * student.sf(away_v / np.maximum(scatter_v * np.sqrt(1.0 + of_fit), 1e-300), freedom)
        worst_v = max(float(np.abs(found.fun).max()), _ROUNDING * float(np.ptp(mean[inner])))
        off = (chance < _CHANCE) & (away_v > _LEAVES * worst_v)
        leaving, larger = np.unique(size[outer][off]), np.unique(size[outer])
        if larger[0] in leaving and leaving.size >= _MOST * larger.size:
            return float(level)
    return float(levels[-1])


def _sine(parameters: FloatArray, at: FloatArray) -> FloatArray:
    K0, U0, S = parameters
    return np.asarray(U0 + K0 * at * np.sinc(S * at / np.pi))


def _slopes(parameters: FloatArray, at: FloatArray) -> FloatArray:
    """Return the derivatives of the sine by K0, U0 and S, shape (n, 3)."""
    K0, S = parameters[0], max(abs(parameters[2]), 1e-9)  # the limit of a straight line
    return np.column_stack([np.sin(S * at) / S, np.ones(at.size), K0 * (np.cos(S * at) * at - np.sin(S * at) / S) / S])


def _sine_through(rate: FloatArray, mean: FloatArray) -> OptimizeResult:
    """Fit the sine by least squares: `x` are K0, U0 and S."""
    slope, offset = np.polyfit(rate, mean, 1)

    def misfit(parameters: FloatArray) -> FloatArray:
        return _sine(parameters, rate) - mean

    return least_squares(
        misfit,
        np.array([slope, offset, _START_S]),
        x_scale=[abs(slope), abs(slope), 1e-3],
        xtol=1e-14,
        ftol=1e-14,
    )


def _fit(rate: FloatArray, mean: FloatArray, use: BoolArray) -> PointsFit:
    """Fit both laws to the points in use; the residuals are those of all points."""
    x, y = rate[use], mean[use]
    slope, offset = np.polyfit(x, y, 1)
    found = _sine_through(x, y)
    if not found.success:
        raise UsageError(
            f"static points: the sine law does not fit: {in_line(found.message)}; look for a point that is off"
        )
    K0, U0, S = found.x
    S = abs(S)
    freedom = x.size - _PARAMETERS
    jacobian = np.asarray(found.jac, dtype=np.float64)
    covariance = np.linalg.inv(jacobian.T @ jacobian) * 2 * found.cost / freedom
    half = coverage_factor(freedom, 0.95) * np.sqrt(np.diag(covariance))
    indicated = (mean - U0) / K0
    # Beyond the sine's reach the residual is computed with its slope at low rates.
    residual_sine = np.where(
        np.abs(S * indicated) <= 1,
        np.arcsin(np.clip(S * indicated, -1, 1)) / S - rate,
        (mean - _sine(found.x, rate)) / K0,
    )
    residual_line = (mean - offset) / slope - rate
    scale = float(np.max(np.abs(x)))
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
