"""Sequentially thresholded least squares (pysindy's STLSQ), with the threshold chosen on held-out steps.

Rows enter as the triangular factors of their QR decomposition, one per fold: sums of squares and solutions equal those
of all rows, at a small part of the cost.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchctl.proof.generic.rows import Rows
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import UsageError

FOLDS = 5
THRESHOLDS = np.geomspace(1e-3, 3.0, 32)
"""Candidate thresholds for a coefficient: the rms of its term's contribution in units of a row's noise."""

_RIDGE = 1e-3
_DISTINCT = 1e-4
"""A column is left out if less than this share of it remains after projection on the baseline."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sparse:
    """The chosen model: coefficients of unit-rms columns in units of a row's noise, shape (terms,), zero where dropped.

    `heldout` is the rms of the residual of steps that were not fitted, in units of a row's noise.
    """

    coefficients: FloatArray
    threshold: float
    heldout: float


def sparse(baseline: FloatArray, columns: FloatArray, rows: Rows) -> Sparse:
    """Return the sparsest model within one standard error of the best one in cross-validation over complete steps.

    Parameters
    ----------
    baseline
        Terms that are always fitted and never counted, shape (n, b).
    columns
        The library, shape (n, terms).
    rows
        The rows to which the columns belong.

    Raises
    ------
    UsageError
        If pysindy is not installed.
    """
    fold = folds_of(rows.step)
    table = np.column_stack([baseline, columns, rows.residual_v / rows.noise_v])
    factors = [_triangle(table[fold == k]) for k in range(FOLDS)]
    counts = np.array([np.count_nonzero(fold == k) for k in range(FOLDS)])
    split = baseline.shape[1]
    losses = np.empty((THRESHOLDS.size, FOLDS))
    for k, held in enumerate(factors):
        kept = [factor for i, factor in enumerate(factors) if i != k]
        fit = _Fit(np.concatenate(kept), split, int(counts.sum() - counts[k]))
        for i, threshold in enumerate(THRESHOLDS):
            left = held[:, :-1] @ fit.coefficients(threshold) - held[:, -1]
            losses[i, k] = left @ left / counts[k]
    chosen = _one_standard_error(losses)
    fit = _Fit(np.concatenate(factors), split, int(counts.sum()))
    found = fit.coefficients(THRESHOLDS[chosen])[split:]
    coefficients = np.where(found == 0.0, 0.0, found * np.where(np.isinf(fit.scale), 0.0, fit.scale))
    heldout = float(np.sqrt(losses[chosen] @ counts / counts.sum()))
    return Sparse(coefficients=coefficients, threshold=float(THRESHOLDS[chosen]), heldout=heldout)


class _Fit:
    """Thresholded least squares on rows given as triangular factors; the baseline is solved exactly.

    `scale` is the rms of each column of the library after the baseline is projected out.
    """

    def __init__(self, factors: FloatArray, split: int, rows: int) -> None:
        triangle = _triangle(factors) / np.sqrt(rows)
        self._top, self._rest = triangle[:split], triangle[split:, split:]
        self._split = split
        rms = np.sqrt(np.sum(self._rest[:, :-1] ** 2, axis=0))
        raw = np.sqrt(np.sum(triangle[:, split:-1] ** 2, axis=0))
        self.scale = np.where(rms > _DISTINCT * raw, rms, np.inf)

    def coefficients(self, threshold: float) -> FloatArray:
        """Return the coefficients of the baseline and of the library, shape (b + terms,)."""
        scaled = _fitted(self._rest[:, :-1] / self.scale, self._rest[:, -1], threshold)
        chosen = scaled / self.scale
        right = self._top[:, -1] - self._top[:, self._split : -1] @ chosen
        return np.concatenate([np.linalg.solve(self._top[:, : self._split], right), chosen])


def folds_of(step: IntArray) -> IntArray:
    """Return the fold of each row: complete steps, dealt out by decreasing length so that folds are similar."""
    lengths = np.bincount(step)
    fold = np.empty(lengths.size, np.int64)
    fold[np.argsort(-lengths, kind="stable")] = np.arange(lengths.size) % FOLDS
    return fold[step]


def _triangle(table: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.qr(table, mode="r"), dtype=np.float64)


def _one_standard_error(losses: FloatArray) -> int:
    """Return the index of the largest threshold within one standard error of the least loss (thresholds, folds)."""
    means = losses.mean(axis=1)
    best = int(means.argmin())
    error = losses[best].std(ddof=1) / np.sqrt(losses.shape[1])
    return int(np.flatnonzero(means <= means[best] + error)[-1])


def _fitted(columns: FloatArray, target: FloatArray, threshold: float) -> FloatArray:
    optimizer: Any = _stlsq()(threshold=threshold, alpha=_RIDGE, max_iter=50)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # all terms dropped, or no convergence: both are valid answers
        optimizer.fit(columns, target[:, None])
    return np.asarray(optimizer.coef_, dtype=np.float64).ravel()


def _stlsq() -> Any:
    try:
        from pysindy.optimizers import STLSQ
    except ImportError as err:
        raise UsageError("the generic arm needs pysindy: pip install 'benchctl[test]', or leave it out") from err
    return STLSQ
