"""Linear least squares: coefficients, and their covariance if the residuals of one step are correlated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchctl_instruments.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class LinearFit:
    """Coefficients (p,), their covariance (p, p), the residuals (n,) and the degrees of freedom."""

    coefficients: FloatArray
    covariance: FloatArray
    residual: FloatArray
    dof: int


def fit_linear(columns: FloatArray, values: FloatArray) -> LinearFit:
    """Minimise Σ (values − columns·c)²; columns (n, p). With as many values as coefficients the variance is NaN."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    basis, triangle = np.linalg.qr(columns / scale)
    inverse = np.linalg.pinv(triangle)
    coefficients = inverse @ (basis.T @ values) / scale
    residual = values - columns @ coefficients
    freedom = values.size - columns.shape[1]
    variance = float(residual @ residual) / freedom if freedom > 0 else np.nan
    covariance = variance * (inverse @ inverse.T) / scale[:, None] / scale
    return LinearFit(coefficients=coefficients, covariance=covariance, residual=residual, dof=freedom)


def clustered_covariance(columns: FloatArray, residual: FloatArray, cluster: IntArray) -> tuple[FloatArray, int]:
    """Return the covariance (p, p) of unweighted coefficients for residuals correlated within a cluster, and its dof.

    A cluster is a step. Liang and Zeger, Biometrika 73 (1986) 13, with the usual correction for the number of clusters.
    With fewer than twice as many clusters as coefficients, the plain covariance times the number of blocks per cluster
    is used: an upper bound.
    """
    p = columns.shape[1]
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    scaled = columns / scale
    bread = np.linalg.pinv(scaled.T @ scaled)
    names = np.unique(cluster)
    if names.size < 2 * p:
        size = columns.shape[0] / names.size
        covariance, dof = bread * float(residual @ residual) / max(residual.size - p, 1) * size, names.size
    else:
        scores = np.stack([scaled[cluster == name].T @ residual[cluster == name] for name in names])
        covariance = bread @ (scores.T @ scores) @ bread * names.size / (names.size - p)
        dof = names.size - p
    return covariance / scale[:, None] / scale, dof
