"""What a fit has left, and how much of it any set of columns would explain: all tests of it are quadratic forms.

With e the whitened residual, D the whitened derivatives of everything that was fitted and C the columns, the scores are
S = Cᵀe, their covariance under nothing missing is σ²·V, V = CᵀC − CᵀD·(DᵀD)⁻¹·DᵀC, and SᵀV⁻¹S is by how much the sum
of squares falls when the columns are fitted too, everything else refitted beside them. Divided by σ² it is χ² of as
many degrees of freedom as V has ranks.

Noise is never quite what it is said to be: encoder noise is coloured by the differentiator, some rows are noisier than
others. So the covariance of the scores is also taken from the data, from sums over short blocks of rows with what the
columns explain taken off (a sandwich; White, Econometrica 48, 1980). Where it is larger, the χ² is of that size and
of so many degrees of freedom (Satterthwaite, Biometrics 2, 1946), so that odd noise is not taken for a structure.
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
"""A column with less than this share of the largest column's power is hardly ever visited: it is left out."""
_DEPENDENT = 1e-5
"""Share of a direction's power that must be left when the fit is taken off: below it is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """What columns would explain of what is left.

    `gain` is in twice the log likelihood, `drop` the fall of the sum of squares, `dof` how many directions the columns
    have beside the fit, `log_p` the logarithm of the chance that noise brings as much, `inflation` by how much the
    scores scatter more than white noise lets them. `profile` (n,) is what would be explained, sample by sample.
    """

    gain: float
    drop: float
    dof: int
    log_p: float
    inflation: float
    profile: FloatArray


class ScoreTest:
    """A whitened residual (n,) with the whitened derivatives (n, p) of what was fitted, on the rows of a mask (n,)."""

    def __init__(self, white: FloatArray, derivatives: FloatArray, rows: BoolArray) -> None:
        self.rows = rows.astype(np.float64)
        # row by row, as sparse columns are multiplied with it
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
        """The mean square of what is left."""
        return float(self.squares / self.freedom)

    def gain(self, drop: float) -> float:
        """Twice the log likelihood that is gained where the sum of squares falls by `drop`."""
        if self.squares <= 0.0:
            return 0.0
        return float(-self.freedom) * math.log1p(-min(drop / self.squares, 1.0 - 1e-12))

    def without(self, profile: FloatArray) -> ScoreTest:
        """What is left when a profile (n,) has been explained."""
        other = ScoreTest.__new__(ScoreTest)
        other.rows, other.known, other.inverse = self.rows, self.known, self.inverse
        other.white = self.white - profile
        other.squares = float(other.white @ other.white)
        other.freedom = self.freedom
        return other

    def seen(self, columns: Columns) -> Seen:
        """What whitened columns, shape (n, k), sparse or not, would explain beside what was fitted.

        They are changed: the rows that do not count are taken off.
        """
        columns = _masked(columns, self.rows)
        products = np.asarray(columns.T @ _like(columns, self.white), dtype=np.float64)
        crossed = np.asarray(columns.T @ _like(columns, self.known), dtype=np.float64)
        each_other = columns.T @ columns
        each_other = np.asarray(each_other.toarray() if scipy.sparse.issparse(each_other) else each_other, np.float64)
        root = _root(each_other, crossed @ self.inverse @ crossed.T)
        dof = root.shape[1]
        if dof == 0 or self.squares <= 0.0:
            return Seen(gain=0.0, drop=0.0, dof=0, log_p=0.0, inflation=1.0, profile=np.zeros_like(self.white))
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
        return Seen(
            gain=self.gain(drop),
            drop=drop,
            dof=dof,
            log_p=log_chance(drop / variance / scale, freedom),
            inflation=max(1.0, mean / dof),
            profile=profile,
        )

    def _scattered(self, columns: Columns, crossed: FloatArray, rest: FloatArray) -> FloatArray:
        """Σ over blocks of the products of the scores of columns with what was fitted taken off, shape (k, k).

        `crossed` (k, p) are the columns' products with what is known, `rest` (n,) is what the columns leave. A block
        meets few of the columns that are sparse: so its sums are, and what was fitted is taken off their products.
        """
        sums, of_known = _block_sums(columns, rest), block_products(self.known, rest)
        taken = self.inverse @ crossed.T
        own = sums.T @ sums
        both = np.asarray(sums.T @ of_known, dtype=np.float64) @ taken
        own = np.asarray(own.toarray() if scipy.sparse.issparse(own) else own, dtype=np.float64)
        return np.asarray(own - both - both.T + taken.T @ (of_known.T @ of_known) @ taken)


def log_chance(chi_squared: float, freedom: float) -> float:
    """Logarithm of the chance that χ² is as large; where that is no number any more, by its leading terms."""
    exact = float(scipy.stats.chi2.logsf(chi_squared, freedom))
    if math.isfinite(exact):
        return exact
    half = 0.5 * freedom
    return -0.5 * chi_squared + (half - 1.0) * math.log(0.5 * chi_squared) - float(scipy.special.gammaln(half))


def for_entries(columns: scipy.sparse.csr_array, values: FloatArray) -> FloatArray:
    """A value of each row, shape (n,), for each of the entries of sparse columns (n, k)."""
    entries = np.diff(columns.indptr)
    alike = entries.size > 0 and bool((entries == entries[0]).all())
    return np.repeat(values, int(entries[0]) if alike else entries)


def _pseudo_inverse(information: FloatArray) -> FloatArray:
    if information.size == 0:
        return information
    return np.asarray(np.linalg.pinv(information, rcond=1e-10, hermitian=True), dtype=np.float64)


def _masked(columns: Columns, rows: FloatArray) -> Columns:
    """The columns, which nobody else has, without the rows that do not count."""
    if isinstance(columns, np.ndarray):
        columns *= rows[:, None].astype(columns.dtype)
    else:
        columns.data *= for_entries(columns, rows)
    return columns


def _like(columns: Columns, values: FloatArray) -> Any:
    """Values as exact as the columns, so that no copy of these is made."""
    return values.astype(columns.dtype, copy=False)


def _root(gram: FloatArray, known: FloatArray) -> FloatArray:
    """R (k, r) with RᵀVR = 1 for V = gram − known, in the directions that are seen and that the fit does not have."""
    power = np.diag(gram)
    seen = power > _UNSEEN * max(float(power.max(initial=0.0)), 1e-300)
    scale = np.where(seen, 1.0 / np.sqrt(np.where(seen, power, 1.0)), 0.0)
    values, vectors = np.linalg.eigh((gram - known) * np.outer(scale, scale))
    kept = values > _DEPENDENT
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]) * scale[:, None])


def _block_sums(columns: Columns, values: FloatArray) -> FloatArray | scipy.sparse.csr_array:
    """Σ of columns times values over each block of rows, shape (blocks, k), sparse where they are."""
    if isinstance(columns, np.ndarray):
        return block_products(columns, _like(columns, values))
    starts = block_starts(values.size)
    entries = columns.data * for_entries(columns, values)
    ends = np.append(columns.indptr[starts], columns.indptr[-1:])
    sums = scipy.sparse.csr_array((entries, columns.indices.copy(), ends), shape=(starts.size, columns.shape[1]))
    sums.sum_duplicates()
    return sums
