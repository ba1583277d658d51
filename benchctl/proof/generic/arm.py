"""Analyse a recording with the generic arm."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
from threadpoolctl import threadpool_limits

from benchctl.proof.generic.library import TERMS, baseline, library
from benchctl.proof.generic.rows import Rows, rows_of
from benchctl.proof.generic.sparse import FOLDS, folds_of, sparse
from benchctl.recordings.reader import Recording
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class Regression:
    """The selected terms with their coefficients (rms contribution over a row's noise), and the effects they stand for.

    `heldout_ratio` is the held-out residual over the noise: the smaller of the regression's and a boosted tree's.
    """

    terms: dict[str, float]
    effects: tuple[str, ...]
    heldout_ratio: float
    threshold: float


def available() -> bool:
    """Return whether pysindy is installed."""
    return find_spec("pysindy") is not None


def regress(recording: Recording) -> Regression:
    """Fit the residual of the lab's model by sparse regression.

    Raises
    ------
    UsageError
        If the recording is not suitable, or pysindy is not installed.
    """
    rows = rows_of(recording)
    names, columns = library(rows)
    chosen = sparse(baseline(rows), columns, rows)
    kept = {names[k]: float(chosen.coefficients[k]) for k in np.flatnonzero(chosen.coefficients)}
    return Regression(
        terms=kept,
        effects=tuple(sorted({TERMS[name][0] for name in kept})),
        heldout_ratio=min(chosen.heldout, boosted(baseline(rows), rows)),
        threshold=chosen.threshold,
    )


def boosted(baseline: FloatArray, rows: Rows) -> float:
    """Return the held-out residual over the noise of a boosted tree, with the baseline terms (n, b) refitted.

    Complete steps are held out. Raises `UsageError` if scikit-learn is not installed.
    """
    try:
        from sklearn.ensemble import HistGradientBoostingRegressor
    except ImportError as err:
        raise UsageError("the generic arm needs scikit-learn: pip install 'benchctl[test]', or leave it out") from err
    turn = np.radians(rows.angle_deg)
    columns = [rows.rate_dps, rows.acceleration_dps2, rows.warmer_c, rows.warms_c_per_s, rows.time_s, rows.output_v]
    table = np.column_stack([*columns, np.cos(turn), np.sin(turn)])
    fold = folds_of(rows.step)
    left = np.empty_like(rows.residual_v)
    for k in range(FOLDS):
        held = fold == k
        linear, *_ = np.linalg.lstsq(baseline[~held], rows.residual_v[~held], rcond=None)
        rest = (rows.residual_v - baseline @ linear) / rows.noise_v
        tree = HistGradientBoostingRegressor(max_iter=200, early_stopping=True, random_state=0)
        with threadpool_limits(limits=1):  # OpenMP threads spin at barriers: minutes on a busy machine
            tree.fit(table[~held], rest[~held])
            left[held] = rest[held] - tree.predict(table[held])
    return float(np.sqrt(np.mean(left**2)))
