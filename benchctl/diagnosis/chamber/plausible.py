"""Bounds of a chamber model's parameters: what physics allows and what a recording of this length can show."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchctl.diagnosis.chamber.rows import ChamberRows
from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect
from benchctl_instruments.physics.effects.effect import DescribedEffect

Bounds = Mapping[str, tuple[float, float]]

LENGTHS = 5.0
"""Longest time constant in recording lengths; a longer one is not distinguishable from air that loses no heat."""
_ROOM_C = (5.0, 40.0)
"""Rated temperature range of laboratory equipment (IEC 61010-1, 1.4.1)."""
_HEAT = 2.0
"""Maximum gain, as a multiple of the gain that heats the air by its span at the longest time constant."""
_FASTEST_DRIFT = 60.0
"""Fastest drift, K/h; faster changes are heat storage, not drift."""
_MOST_LOSS = 19.0
"""Largest relative change of the loss: a closing door or stopping fan leaves at least a twentieth of the loss."""
_EDGE = 1.0 / 40.0
"""Share of a run next to its ends in which a change of the loss is confused with the air's start or hardly visible."""
_OFFSET_SHARE, _LEAST_OFFSET_K = 0.5, 10.0
_START_K, _START_STEPS = 2.0, 10.0


def baseline_bounds(rows: ChamberRows) -> dict[str, tuple[float, float]]:
    """Return bounds of every parameter that the baseline of such a recording can have, by name.

    The gain of a heater is positive; a current may also cool.
    """
    span, lasts_s = float(np.ptp(rows.temperature_c[rows.usable])), lasting_s(rows)
    mean_drive = float(np.mean(np.abs(rows.drive))) or 1.0
    most = _HEAT * LENGTHS * span / mean_drive
    least = -most if rows.channel == "current_a" else 0.0
    first_c, about_k = first_air_c(rows), _START_K + _START_STEPS * rows.step_c
    offset_k = max(_OFFSET_SHARE * span, _LEAST_OFFSET_K)
    return {
        "gain": (least, most),
        "tau_s": (rows.interval_s, LENGTHS * lasts_s),
        "ambient_c": _ROOM_C,
        "offset_c": (-offset_k, offset_k),
        "start_c": (first_c - about_k, first_c + about_k),
    }


def lasting_s(rows: ChamberRows) -> float:
    """Return the duration of the longest run [s]."""
    return float(rows.run_s.max()) + rows.interval_s


def first_air_c(rows: ChamberRows) -> float:
    """Return the air temperature at the start, the median of the first readings [°C]."""
    return float(np.median(rows.air_c[:5]))


def bounded_kinds(rows: ChamberRows, kinds: Mapping[str, type[ChamberEffect]]) -> dict[str, type[DescribedEffect]]:
    """Return the effects with bounds and starting values that suit a recording of this length."""
    lasts_s = lasting_s(rows)
    limits: Mapping[tuple[str, str], tuple[float, float]] = {
        ("dead_time", "delay_s"): (0.0, lasts_s / 4.0),
        ("second_lag", "tau_s"): (rows.interval_s, lasts_s),
        ("heat_store", "tau_s"): (2.0 * rows.interval_s, lasts_s),
        ("exchange", "rate_per_s"): (0.0, 1.0 / rows.interval_s),
        ("ambient_drift", "c_per_hour"): (-_FASTEST_DRIFT, _FASTEST_DRIFT),
        ("loss_step", "fraction"): (-1.0, _MOST_LOSS),
        ("loss_step", "moment"): (_EDGE, 1.0 - _EDGE),
    }

    return {
        name: kind.within({one: limits[name, one] for one in kind.parameters if (name, one) in limits})
        for name, kind in kinds.items()
    }


def fair_sizes(rows: ChamberRows) -> Mapping[str, tuple[Mapping[str, float], ...]]:
    """Return parameters of effects of moderate size, by identifier, as further starts of a fit.

    If a model misses much, the influence of a small effect does not show what an effect of the true size would do.
    """
    lasts_s = lasting_s(rows)
    fair_drift = min(0.1 * float(np.ptp(rows.temperature_c[rows.usable])) * 3600.0 / lasts_s, 0.5 * _FASTEST_DRIFT)
    return {
        "second_lag": ({"tau_s": 0.03 * lasts_s},),
        "dead_time": ({"delay_s": 0.02 * lasts_s},),
        "heat_store": ({"capacity": 0.3, "tau_s": 0.1 * lasts_s}, {"capacity": 1.0, "tau_s": 0.3 * lasts_s}),
        "exchange": ({"rate_per_s": 10.0 / lasts_s},),
        "ambient_drift": ({"c_per_hour": fair_drift}, {"c_per_hour": -fair_drift}),
        "radiation": ({"share": 0.5},),
        "heater_nonlinearity": ({"curvature": 0.3},),
        "loss_step": tuple(
            {"fraction": fraction, "moment": place / 40} for place in range(2, 39) for fraction in (-0.8, -0.5, 1.0)
        ),
    }
