"""The curves behind the coefficients, with their 95 % bands: k(ω), k(T), the output by a joint fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchctl.calibration.laws_fit import law_of
from benchctl.calibration.model import Law, factor
from benchctl.calibration.result import CalibrationResult, JointFit, MeanPoints, PolynomialFactor, Stage
from benchctl.calibration.uncertainty import coverage_factor
from benchctl_instruments.arrays import FloatArray

Z95 = 1.959964
"""Half-width of a 95 % interval in standard uncertainties, normal distribution."""

_NEAR_T0_C = 1.5
_AT_REST_DPS = 0.05  # the Earth turns by less


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """A function with the half-width of its 95 % band, both of shape (n,)."""

    value: FloatArray
    half: FloatArray


def factor_curve(of: PolynomialFactor, argument: FloatArray) -> Curve:
    """A factor k against ΔT, or against ω² where its powers are even; argument of shape (n,)."""
    powers = np.stack([argument ** (i + 1) for i in range(len(of.coefficients))], axis=-1)
    covariance = np.array(of.covariance, dtype=np.float64).reshape(len(of.coefficients), -1)
    variance = np.einsum("ni,ij,nj->n", powers, covariance, powers)
    half = coverage_factor(of.dof, 0.95) * np.sqrt(np.maximum(variance, 0.0))
    return Curve(value=factor(of.coefficients, argument), half=half)


def bias(joint: JointFit, dt_c: FloatArray) -> FloatArray:
    """The output at rest, by a joint fit; shape as ΔT."""
    _, _, offset, terms = law_of(joint)
    return offset + factor(terms, dt_c) - 1.0


def joint_curve(joint: JointFit, function: Callable[[Law, FloatArray], FloatArray]) -> Curve:
    """A function of a law and its parameters, with the band that the parameters' covariance gives it."""
    law, best, *_ = law_of(joint)
    order = [[parameter.name for parameter in joint.parameters].index(name) for name in law.names]
    covariance = np.asarray(joint.covariance)[np.ix_(order, order)]
    steps = np.sqrt(np.diag(covariance))
    value = function(law, best)
    slopes = np.zeros((value.size, best.size))
    for i, step in enumerate(steps):
        if step > 0:
            shift = np.zeros(best.size)
            shift[i] = step
            slopes[:, i] = (function(law, best + shift) - function(law, best - shift)) / (2 * step)
    variance = np.einsum("ni,ij,nj->n", slopes, covariance, slopes)
    return Curve(value=value, half=Z95 * np.sqrt(np.maximum(variance, 0.0)))


def at_reference(result: CalibrationResult) -> npt.NDArray[np.bool_]:
    """Which of the mean points were taken at T0, to within 1.5 °C; shape (n,)."""
    return np.asarray(np.abs(result.points.temperature_c - result.T0_c) <= _NEAR_T0_C)


def zero_reading(result: CalibrationResult, stage: Stage) -> float:
    """The bias while k(ω) was measured: the readings at rest at T0, or U0 of the stage where there are none."""
    points = result.points
    rest = at_reference(result) & (np.abs(points.rate_dps) < _AT_REST_DPS)
    if not rest.any():
        return stage.U0_v
    return float(np.mean(points.output_v[rest] - stage.K0_v_per_dps * points.rate_dps[rest]))


def indicated(points: MeanPoints, K0: float, U0: float) -> FloatArray:
    """The rate that a straight line reads from the means, °/s; shape (n,)."""
    return np.asarray((points.output_v - U0) / K0)
