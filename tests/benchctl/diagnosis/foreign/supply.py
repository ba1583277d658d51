"""The supply of the gyro, which one of the labs records beside the rest."""

from __future__ import annotations

import numpy as np
from scipy import signal

from tests.benchctl.diagnosis.foreign.linear import FloatArray

NOMINAL_V = 5.0

_WANDER_V, _WANDER_S = 0.04, 150.0
_SAG_V = 0.06


def supply_deviation(time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """How far the supply is from nominal (V) at `time_s`: it wanders, and sags while another instrument is on."""
    knots = np.arange(time_s[0] - 1.0, time_s[-1] + 2.0)
    keeps = np.exp(-1.0 / _WANDER_S)
    kicks = rng.normal(0.0, _WANDER_V * np.sqrt(1.0 - keeps**2), knots.size)
    slow = signal.lfilter([1.0], [1.0, -keeps], kicks)
    for begins in rng.uniform(knots[0], knots[-1], 8):
        slow[(knots > begins) & (knots < begins + rng.uniform(20.0, 200.0))] -= _SAG_V
    return np.interp(time_s, knots, slow)
