"""The pull of a residual that is written down, without a recording and a fit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.search.pull import Pull, pull_of
from benchctl.estimation.fit import inverse
from benchctl.estimation.noise import Whitener

FloatArray = npt.NDArray[np.float64]


def pulled(residual: FloatArray, known: FloatArray | None = None, *, whitener: Any = None) -> Pull:
    """The pull of a whitened residual of deviation 1, shape (n,), beside a model with derivatives `known` (n, p)."""
    derivatives = np.zeros((residual.size, 0)) if known is None else known
    information = inverse(derivatives.T @ derivatives) if derivatives.size else np.zeros((0, 0))
    left = residual - derivatives @ (information @ (derivatives.T @ residual))
    problem: Any = SimpleNamespace(step=np.zeros(residual.size, np.int64))
    fitted: Any = SimpleNamespace(
        fitted=np.ones(1, np.bool_),
        white=left,
        deviation=1.0,
        derivatives=derivatives,
        numbers=tuple(range(derivatives.shape[1])),
        inverse_information=information,
    )
    plain = Whitener(interval_s=0.01, weight=np.ones(residual.size))
    return pull_of(problem, whitener or plain, fitted)
