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


_LEAST_LEFT = 1e-8
"""Share of a cluster's residuals below which the fit has taken them, and nothing can be corrected."""


def clustered_covariance(columns: FloatArray, residual: FloatArray, cluster: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the covariance (p, p) of unweighted coefficients for residuals correlated within a cluster, and dof (p,).

    A cluster is a step. The residuals of each are corrected for what the fit takes from them, and each coefficient has
    the degrees of freedom of those clusters that determine it (Bell and McCaffrey, Survey Methodology 28 (2002) 169).
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
        covariance = bread * float(residual @ residual) / max(residual.size - p, 1) * size
        return covariance / scale[:, None] / scale, np.full(p, float(names.size))
    scores, own = np.empty((2, names.size, p))
    shared = np.empty((names.size, p, p))
    for place, name in enumerate(names):
        inside = cluster == name
        basis, triangle = np.linalg.qr(scaled[inside])
        taken, directions = np.linalg.eigh(triangle @ bread @ triangle.T)
        left = 1.0 - taken
        grown = np.where(left > _LEAST_LEFT, 1.0 / np.sqrt(np.maximum(left, _LEAST_LEFT)), 0.0)
        corrected = (directions * grown) @ directions.T @ triangle
        scores[place] = corrected.T @ (basis.T @ residual[inside])
        own[place] = np.sum((corrected @ bread) ** 2, axis=0)
        shared[place] = triangle.T @ corrected @ bread
    covariance = bread @ (scores.T @ scores) @ bread
    # The squared contributions of the clusters under white noise: their expected products, for each coefficient.
    products = -np.einsum("sil,ij,tjl->lst", shared, bread, shared, optimize=True)
    products[:, range(names.size), range(names.size)] += own.T
    dof = np.trace(products, axis1=1, axis2=2) ** 2 / np.maximum(np.sum(products**2, axis=(1, 2)), 1e-300)
    return covariance / scale[:, None] / scale, np.maximum(dof, 1.0)
