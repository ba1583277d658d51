"""Where the five terms do not describe a record, which may have a line in its spectrum, correlated noise, or a filter.

The terms are fitted to any record. In one that is made of something else they may be wrong by an order of magnitude,
and their intervals, which hold for noise that is made of the terms, say nothing of that. Where the misfit is largest is
evidence and not the place of its cause: a line of 1 Hz can spoil the fit at a minute.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import chdtr, chdtrc

FloatArray = npt.NDArray[np.float64]

_NEAR = 0.05
"""The part of the larger one by which a deviation may lie from the terms': so near, a coefficient is still of use."""
_CHANCE = 1e-6
"""By chance alone, none of a thousand records lies outside at any of some fifty averaging times."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Misfit:
    """The averaging time at which a deviation lies farthest from what the terms make, and both in the series' unit."""

    tau_s: float
    deviation: float
    modelled: float


def misfit_of(tau_s: FloatArray, deviation: FloatArray, modelled: FloatArray, freedom: FloatArray) -> Misfit | None:
    """The worst misfit over the averaging times that were fitted, all (k,); None where the terms describe the record.

    It is one where chance does not make it, by χ² with the degrees of freedom of the terms, and where it is no trifle.
    """
    apart = np.abs(deviation - modelled) / np.maximum(deviation, modelled)
    squares = freedom * (deviation / modelled) ** 2
    by_chance = 2.0 * np.minimum(chdtr(freedom, squares), chdtrc(freedom, squares))
    apart[by_chance > _CHANCE] = 0.0
    worst = int(np.argmax(apart))
    if apart[worst] <= _NEAR:
        return None
    return Misfit(tau_s=float(tau_s[worst]), deviation=float(deviation[worst]), modelled=float(modelled[worst]))
