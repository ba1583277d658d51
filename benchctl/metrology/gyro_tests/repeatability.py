"""Repeatability over turn-ons: the standard deviation of scale factor and bias over power cycles.

For each turn-on the first stretch at the reference's set point counts; the scale factor is that of the rates that all
of them share. The uncertainty is that of these cycles' deviation; a note states the range for another set of as many
cycles.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.special import chdtri

from benchctl.metrology.observations import Observations, column, dots, has_rest, measured, refused, same_set_point
from benchctl.metrology.points import Points, line
from benchctl.metrology.propagation import Offsets, as_read, deviation_of, standards
from benchctl.metrology.result import Measured, Message, message
from benchctl_instruments.arrays import FloatArray

_FEWEST = 3
_NAMES = ("scale_factor_repeatability", "bias_repeatability")
_DEG_PER_H = 3600.0


def repeatability_tests(obs: Observations) -> Iterator[Measured]:
    """Yield the repeatability of scale factor and bias."""
    cycles = _cycles(obs)
    if len(cycles) < _FEWEST:
        why = message("needs_power_cycles", found=len(cycles), needed=_FEWEST)
        yield from (refused(name, why) for name in _NAMES)
        return
    points = obs.swept_in(cycles)
    rates = _common_rates(points, cycles)
    if rates.size > 1:
        yield _of_scale(obs, points.of(np.isin(points.set_dps, rates)), cycles)
    else:
        yield refused("scale_factor_repeatability", message("needs_rates", found=int(rates.size), needed=2))
    if all(has_rest(points.of(points.stretch == cycle)) for cycle in cycles):
        yield _of_bias(obs, points, cycles)
    else:
        yield refused("bias_repeatability", message("needs_rest"))


def _cycles(obs: Observations) -> list[int]:
    """Return, for each turn-on, the first stretch with rates at the reference's set point."""
    if obs.reference is None:
        return []
    home_c = obs.stretches[obs.reference].setpoint_c
    first: dict[int, int] = {}
    for number, stretch in enumerate(obs.stretches):
        rates = np.unique(obs.swept_in([number]).set_dps)
        if not stretch.across and same_set_point(stretch.setpoint_c, home_c) and rates.size > 1:
            first.setdefault(stretch.power_on, number)
    return sorted(first.values())


def _common_rates(points: Points, cycles: list[int]) -> FloatArray:
    common = set(points.set_dps.tolist())
    for cycle in cycles:
        common &= set(points.set_dps[points.stretch == cycle].tolist())
    return np.array(sorted(common))


def _of_scale(obs: Observations, points: Points, cycles: list[int]) -> Measured:
    chosen = [points.stretch == cycle for cycle in cycles]

    def slopes(offsets: Offsets) -> FloatArray:
        rate_dps, output_v = points.moved(offsets)
        return np.stack([line(rate_dps[:, own], output_v[:, own])[0] for own in chosen], axis=1)

    def ppm(offsets: Offsets) -> FloatArray:
        found = slopes(offsets)
        return np.asarray(1e6 * found / found.mean(axis=1, keepdims=True))

    quantities = obs.quantities(points)
    value, uncertainty = deviation_of(ppm, quantities)
    table = (
        column("turn_on", "1", np.arange(1.0, len(cycles) + 1)),
        column("scale_factor", "mV/(deg/s)", 1e3 * as_read(slopes, quantities)),
    )
    return measured(
        "scale_factor_repeatability",
        value,
        uncertainty,
        points,
        notes=(_of_others(value, len(cycles)),),
        table=table,
        picture=dots(*table, standard=1e-6 * np.array(table[1].values) * standards(ppm, quantities)),
    )


def _of_bias(obs: Observations, points: Points, cycles: list[int]) -> Measured:
    slope = obs.scale_v_per_dps
    first = np.array([np.flatnonzero((points.stretch == cycle) & (points.set_dps == 0.0))[0] for cycle in cycles])

    def biases(offsets: Offsets) -> FloatArray:
        return np.asarray(_DEG_PER_H * points.moved(offsets)[1][:, first] / slope)

    def apart(offsets: Offsets) -> FloatArray:
        found = biases(offsets)
        return np.asarray(found - found.mean(axis=1, keepdims=True))

    quantities = obs.quantities(points)
    value, uncertainty = deviation_of(biases, quantities)
    table = (
        column("turn_on", "1", np.arange(1.0, len(cycles) + 1)),
        column("bias", "deg/h", as_read(biases, quantities)),
    )
    return measured(
        "bias_repeatability",
        value,
        uncertainty,
        points.of(first),
        notes=(_of_others(value, len(cycles)),),
        table=table,
        picture=dots(*table, standard=standards(apart, quantities)),
    )


def _of_others(value: float, cycles: int) -> Message:
    """Return the note with the 95 % interval of the unit's deviation over all turn-ons, if they are normal."""
    freedom = cycles - 1
    low, high = (value * float(np.sqrt(freedom / chdtri(freedom, tail))) for tail in (0.025, 0.975))
    return message("of_these_cycles", cycles=cycles, low=low, high=high)
