"""Score test: how much of a fit's residual any set of columns would explain, computed from quadratic forms.

With e the whitened residual, D the whitened derivatives of all fitted parameters and C the columns, the scores are
S = Cᵀe, their covariance under the null hypothesis is σ²·V, V = CᵀC − CᵀD·(DᵀD)⁻¹·DᵀC, and SᵀV⁻¹S is the decrease of
the sum of squares when the columns are fitted jointly with all other parameters. Divided by σ² it is χ² with as many
degrees of freedom as the rank of V.

Real noise differs from its model: the differentiator colours encoder noise, and some rows are noisier than others. So
the covariance of the scores is also estimated from the data, from sums over short blocks of rows with the explained
part removed (a sandwich; White, Econometrica 48, 1980). If it is larger, the χ² is scaled and its degrees of freedom
are reduced (Satterthwaite, Biometrics 2, 1946), so that unusual noise is not mistaken for a structure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse
import scipy.special
import scipy.stats

from benchctl.signals.blocks import block_products, block_starts, gram
from benchctl_instruments.arrays import BoolArray, FloatArray

Columns = npt.NDArray[np.floating[Any]] | scipy.sparse.csr_array

_UNSEEN = 1e-6
"""Columns with less than this share of the largest column's power have hardly any rows and are left out."""
_DEPENDENT = 1e-5
"""Minimum share of a direction's power that must remain after the fit is removed; less is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """What columns would explain of the residual.

    `gain` is in twice the log likelihood, `drop` the fall of the sum of squares, `dof` the number of directions of the
    columns that the fit does not contain, `log_p` the logarithm of the probability that noise gains as much,
    `inflation` the scatter of the scores relative to white noise. `profile` (n,) is what would be explained per sample.
    """

    gain: float
    drop: float
    dof: int
    log_p: float
    inflation: float
    profile: FloatArray


class ScoreTest:
    """A whitened residual (n,) and the whitened derivatives (n, p) of the fitted parameters, on rows of a mask (n,)."""

    def __init__(self, white: FloatArray, derivatives: FloatArray, rows: BoolArray) -> None:
        self.rows = rows.astype(np.float64)
        # row-major order, because sparse columns are multiplied with it
        known = np.multiply(derivatives, self.rows[:, None], order="C")
        size = np.sqrt(np.einsum("ij,ij->j", known, known))
        known /= np.where(size > 0.0, size, 1.0)
        self.known: FloatArray = known
        self.inverse: FloatArray = _pseudo_inverse(gram(known))
        white = white * self.rows
        self.white: FloatArray = white - known @ (self.inverse @ (known.T @ white))
        self.squares = float(self.white @ self.white)
        self.freedom = max(float(self.rows.sum()) - known.shape[1], 1.0)

    @property
    def variance(self) -> float:
        """The mean square of the residual."""
        return float(self.squares / self.freedom)

    def gain(self, drop: float) -> float:
        """Return the gain in twice the log likelihood if the sum of squares falls by `drop`."""
        if self.squares <= 0.0:
            return 0.0
        return float(-self.freedom) * math.log1p(-min(drop / self.squares, 1.0 - 1e-12))

    def without(self, profile: FloatArray) -> ScoreTest:
        """Return the test of the residual with a profile (n,) removed."""
        other = ScoreTest.__new__(ScoreTest)
        other.rows, other.known, other.inverse = self.rows, self.known, self.inverse
        other.white = self.white - profile
        other.squares = float(other.white @ other.white)
        other.freedom = self.freedom
        return other

    def score(self, columns: Columns) -> Score:
        """Return what whitened columns, shape (n, k), sparse or dense, would explain in addition to the fit.

        The columns are modified in place: rows that do not count are set to zero.
        """
        columns = _masked(columns, self.rows)
        products = np.asarray(columns.T @ _like(columns, self.white), dtype=np.float64)
        crossed = np.asarray(columns.T @ _like(columns, self.known), dtype=np.float64)
        each_other = columns.T @ columns
        each_other = np.asarray(each_other.toarray() if scipy.sparse.issparse(each_other) else each_other, np.float64)
        root = _root(each_other, crossed @ self.inverse @ crossed.T)
        dof = root.shape[1]
        if dof == 0 or self.squares <= 0.0:
            return Score(gain=0.0, drop=0.0, dof=0, log_p=0.0, inflation=1.0, profile=np.zeros_like(self.white))
        scores = root.T @ products
        weights = root @ scores
        drop = float(scores @ scores)
        profile = np.asarray(columns @ _like(columns, weights)) - self.known @ (self.inverse @ (crossed.T @ weights))
        rest = self.white - profile
        variance = max(self.squares - drop, 1e-12 * self.squares) / max(self.freedom - dof, 1.0)
        scatter = root.T @ self._scattered(columns, crossed, rest) @ root / variance
        mean, square = float(np.trace(scatter)), float(np.sum(scatter * scatter))
        freedom = min(mean * mean / square, float(dof))
        scale = max(1.0, square / mean, dof / freedom)
        return Score(
            gain=self.gain(drop),
            drop=drop,
            dof=dof,
            log_p=log_chance(drop / variance / scale, freedom),
            inflation=max(1.0, mean / dof),
            profile=profile,
        )

    def _scattered(self, columns: Columns, crossed: FloatArray, rest: FloatArray) -> FloatArray:
        """Return Σ over blocks of the products of the columns' scores, with the fit removed, shape (k, k).

        `crossed` (k, p) are the columns' products with the derivatives, `rest` (n,) is the residual with the columns
        fitted. Sparse columns have entries in few blocks, so their sums are sparse; the fit is removed from products.
        """
        sums, of_known = _block_sums(columns, rest), block_products(self.known, rest)
        taken = self.inverse @ crossed.T
        own = sums.T @ sums
        both = np.asarray(sums.T @ of_known, dtype=np.float64) @ taken
        own = np.asarray(own.toarray() if scipy.sparse.issparse(own) else own, dtype=np.float64)
        return np.asarray(own - both - both.T + taken.T @ (of_known.T @ of_known) @ taken)


def log_chance(chi_squared: float, freedom: float) -> float:
    """Return the logarithm of the probability of a larger χ²; where it underflows, its asymptotic expansion."""
    exact = float(scipy.stats.chi2.logsf(chi_squared, freedom))
    if math.isfinite(exact):
        return exact
    half = 0.5 * freedom
    return -0.5 * chi_squared + (half - 1.0) * math.log(0.5 * chi_squared) - float(scipy.special.gammaln(half))


def for_entries(columns: scipy.sparse.csr_array, values: FloatArray) -> FloatArray:
    """Return the row values (n,), repeated for each entry of sparse columns (n, k)."""
    entries = np.diff(columns.indptr)
    alike = entries.size > 0 and bool((entries == entries[0]).all())
    return np.repeat(values, int(entries[0]) if alike else entries)


def _pseudo_inverse(information: FloatArray) -> FloatArray:
    if information.size == 0:
        return information
    return np.asarray(np.linalg.pinv(information, rcond=1e-10, hermitian=True), dtype=np.float64)


def _masked(columns: Columns, rows: FloatArray) -> Columns:
    """Set rows that do not count to zero in the columns, in place, and return the columns."""
    if isinstance(columns, np.ndarray):
        columns *= rows[:, None].astype(columns.dtype)
    else:
        columns.data *= for_entries(columns, rows)
    return columns


def _like(columns: Columns, values: FloatArray) -> Any:
    """Return the values in the columns' precision, so that the columns are not copied."""
    return values.astype(columns.dtype, copy=False)


def _root(gram: FloatArray, known: FloatArray) -> FloatArray:
    """Return R (k, r) with RᵀVR = 1 for V = gram − known, in directions with power that the fit does not contain."""
    power = np.diag(gram)
    used = power > _UNSEEN * max(float(power.max(initial=0.0)), 1e-300)
    scale = np.where(used, 1.0 / np.sqrt(np.where(used, power, 1.0)), 0.0)
    values, vectors = np.linalg.eigh((gram - known) * np.outer(scale, scale))
    kept = values > _DEPENDENT
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]) * scale[:, None])


def _block_sums(columns: Columns, values: FloatArray) -> FloatArray | scipy.sparse.csr_array:
    """Return Σ of columns times values over each block of rows, shape (blocks, k), sparse if the columns are."""
    if isinstance(columns, np.ndarray):
        return block_products(columns, _like(columns, values))
    starts = block_starts(values.size)
    entries = columns.data * for_entries(columns, values)
    ends = np.append(columns.indptr[starts], columns.indptr[-1:])
    sums = scipy.sparse.csr_array((entries, columns.indices.copy(), ends), shape=(starts.size, columns.shape[1]))
    sums.sum_duplicates()
    return sums
