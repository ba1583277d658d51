"""What the generic arm says of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from benchctl.proof.generic.boosted import boosted
from benchctl.proof.generic.library import TERMS, baseline, library
from benchctl.proof.generic.rows import rows_of
from benchctl.proof.generic.sparse import sparse
from benchctl.recordings.reader import Recording


@dataclass(frozen=True, slots=True, kw_only=True)
class Regression:
    """The selected terms with their coefficients (rms contribution over a row's noise), and the effects they stand for.

    `heldout_ratio` is the held-out residual over the noise, the smaller of the regression's and of a boosted tree's.
    """

    terms: dict[str, float]
    effects: tuple[str, ...]
    heldout_ratio: float
    threshold: float


def available() -> bool:
    """Whether pysindy is installed."""
    return find_spec("pysindy") is not None


def regress(recording: Recording) -> Regression:
    """Sparse regression of what the lab's model leaves of the output.

    Raises
    ------
    UsageError
        Where the recording cannot be used so, or pysindy is not installed.
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
