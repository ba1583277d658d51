"""A boosted tree on the coordinates of the rows: the generic model for whatever shape the residual has."""

from __future__ import annotations

import numpy as np
from threadpoolctl import threadpool_limits

from benchctl.proof.generic.rows import Rows
from benchctl.proof.generic.sparse import FOLDS, folds_of
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError


def boosted(baseline: FloatArray, rows: Rows) -> float:
    """The residual over the noise on whole steps that were not fitted, beside baseline terms (n, b) refitted.

    Raises `UsageError` where scikit-learn is not installed.
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
