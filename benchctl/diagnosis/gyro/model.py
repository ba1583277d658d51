"""The lab's model of a gyro: its validation before any computation, and a straight line in its place."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

_NUMBERS = ("K0_v_per_dps", "U0_v", "T0_c")
_LISTS = ("k_T", "k_omega")
_MOST_TERMS = 6
_UNIT_SCALE = 5.0
"""Maximum factor between the scale factor of a digital gyro, a pure number, and 1."""


def checked_model(simulation: Mapping[str, Any], *, where: str, digital: bool = False) -> Mapping[str, Any]:
    """Return the model if it defines the gyro's output; additional fields are allowed.

    `digital` is a gyro whose output is a rate: its K0 is then near 1 or -1. Raises `UsageError` with the field, the
    expected value, and the actual value.
    """
    for name in _NUMBERS:
        if name not in simulation:
            raise UsageError(f"{where}: {name} is missing: it must say {', '.join((*_NUMBERS, *_LISTS))}")
        _finite(simulation[name], f"{where}: {name}")
    for name in _LISTS:
        terms = simulation.get(name)
        if not isinstance(terms, list | tuple) or len(terms) > _MOST_TERMS:
            raise UsageError(f"{where}: {name}: expected a list of up to {_MOST_TERMS} numbers, got {terms!r}")
        for term in terms:
            _finite(term, f"{where}: {name}")
    limit = simulation.get("output_limit_v")
    if limit is not None:
        _finite(limit, f"{where}: output_limit_v")
        if not limit > 0:
            raise UsageError(f"{where}: output_limit_v: expected a number above 0, got {limit!r}")
    scale = abs(float(simulation["K0_v_per_dps"]))
    if scale == 0.0:
        raise UsageError(f"{where}: K0_v_per_dps: expected a number other than 0")
    if digital and not 1.0 / _UNIT_SCALE <= scale <= _UNIT_SCALE:
        raise UsageError(
            f"{where}: K0_v_per_dps = {simulation['K0_v_per_dps']!r}, but the gyro's output was recorded in deg/s:"
            " its scale factor is then a number near 1; give a model of this output, or import it in volts"
        )
    return simulation


def straight_line(rate_dps: FloatArray, output: FloatArray, T0_c: float) -> dict[str, Any]:
    """Return the model that is the least-squares line through outputs at rates, shape (n,)."""
    slope, offset = np.polyfit(rate_dps, output, 1).tolist()
    return {"K0_v_per_dps": slope, "U0_v": offset, "T0_c": T0_c, "k_T": [], "k_omega": []}


def _finite(value: object, name: str) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise UsageError(f"{name}: expected a finite number, got {value!r}")
