"""Scale factor and bias over temperature: their sensitivity, and their hysteresis between heating and cooling.

Sensitivity is the largest change from the reference per degree, over all set points that differ by 5 °C or more, from
the rates that both have; the thermometer's errors at two temperatures are assumed independent. Hysteresis is the
largest difference between set points reached by heating and by cooling.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchctl.metrology.names import UNITS
from benchctl.metrology.observations import SAME_C, Observations, column, dots, has_rest, measured, refused
from benchctl.metrology.points import Points, line
from benchctl.metrology.propagation import Offsets, as_read, independent, largest_of, standards
from benchctl.metrology.result import Measured, message
from benchctl_instruments.arrays import FloatArray

_APART_C = 5.0
_DEG_PER_H = 3600.0
_FEWEST_RATES = 2
_NAMES = ("scale_factor_temperature", "bias_temperature", "hysteresis_temperature_scale", "hysteresis_temperature_bias")

Of = Callable[[Offsets], FloatArray]
"""A quantity at every chosen stretch, shape (d, k)."""


def temperature_tests(obs: Observations) -> Iterator[Measured]:
    """Yield sensitivity and hysteresis of scale factor and bias."""
    usable = _usable(obs)
    home = obs.reference
    away = [] if home is None else [one for one in usable if abs(_celsius(obs, one) - _celsius(obs, home)) > _APART_C]
    if home is None or not away:
        why = message("needs_set_points", found=len({obs.stretches[one].setpoint_c for one in usable}), needed=2)
        yield from (refused(name, why) for name in ("scale_factor_temperature", "bias_temperature"))
    else:
        yield from _sensitivities(obs, home, away)
    pairs = _legs(obs, usable)
    if not pairs:
        names = ("hysteresis_temperature_scale", "hysteresis_temperature_bias")
        yield from (refused(name, message("needs_both_legs")) for name in names)
    else:
        yield from _memories(obs, pairs)


def _usable(obs: Observations) -> list[int]:
    """Return stretches with rest and two rates; of several in one soak the last, which has settled best."""
    found: dict[tuple[float, float], int] = {}
    for number, stretch in enumerate(obs.stretches):
        points = obs.swept_in([number])
        if not stretch.across and has_rest(points) and np.unique(points.set_dps).size > 2:
            found[stretch.setpoint_c, stretch.before_c] = number
    return sorted(found.values())


def _celsius(obs: Observations, number: int) -> float:
    return obs.stretches[number].temperature_c


def _slopes(points: Points, chosen: Sequence[np.ndarray]) -> Of:
    def slopes(offsets: Offsets) -> FloatArray:
        rate_dps, output_v = points.moved(offsets)
        return 1e3 * np.stack([line(rate_dps[:, own], output_v[:, own])[0] for own in chosen], axis=1)

    return slopes


def _biases(points: Points, chosen: Sequence[np.ndarray], slope: float) -> Of:
    places = [int(np.flatnonzero(own & (points.set_dps == 0.0))[0]) for own in chosen]

    def biases(offsets: Offsets) -> FloatArray:
        return np.asarray(_DEG_PER_H * points.moved(offsets)[1][:, places] / slope)

    return biases


def _together(obs: Observations, numbers: Sequence[int]) -> tuple[Points, list[np.ndarray]]:
    """Return the points of some stretches at the rates common to all of them, and a mask for each stretch."""
    points = obs.swept_in(numbers)
    common = set(points.set_dps.tolist())
    for number in numbers:
        common &= set(points.set_dps[points.stretch == number].tolist())
    points = points.of(np.isin(points.set_dps, sorted(common)))
    return points, [points.stretch == number for number in numbers]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Kind:
    """Scale factor or bias: its value at every chosen stretch, (d, k), and the function for their difference."""

    name: str
    unit: str
    of: Of
    apart: Callable[[FloatArray, FloatArray], FloatArray]


def _kinds(obs: Observations, points: Points, chosen: Sequence[np.ndarray]) -> tuple[_Kind, _Kind]:
    return (
        _Kind(
            name="scale_factor",
            unit="mV/(deg/s)",
            of=_slopes(points, chosen),
            apart=lambda there, here: 1e6 * (there / here - 1.0),
        ),
        _Kind(
            name="bias",
            unit="deg/h",
            of=_biases(points, chosen, obs.scale_v_per_dps),
            apart=lambda there, here: there - here,
        ),
    )


def _rates(points: Points) -> int:
    return int(np.unique(points.set_dps).size)


def _sensitivities(obs: Observations, home: int, away: Sequence[int]) -> Iterator[Measured]:
    points, chosen = _together(obs, [home, *away])
    celsius = np.array([_celsius(obs, number) for number in (home, *away)])
    warmth = independent(
        "thermometer", np.full(celsius.size, obs.stated.thermometer_c.standard), obs.stated.thermometer_c.says
    )
    quantities, order = [*obs.quantities(points), warmth], np.argsort(celsius)
    for kind in _kinds(obs, points, chosen):
        name = f"{kind.name}_temperature"
        if kind.name == "scale_factor" and _rates(points) < _FEWEST_RATES:
            yield refused(name, message("needs_rates", found=_rates(points), needed=_FEWEST_RATES))
            continue

        def per_degree(offsets: Offsets, kind: _Kind = kind) -> FloatArray:
            found, warm = kind.of(offsets), celsius + offsets["thermometer"]
            return kind.apart(found[:, 1:], found[:, :1]) / (warm[:, 1:] - warm[:, :1])

        values = as_read(kind.of, quantities)[order]
        table = column("temperature", "degC", celsius[order]), column(kind.name, kind.unit, values)
        yield measured(
            name,
            *largest_of(per_degree, quantities),
            points,
            table=table,
            picture=dots(*table, standard=standards(kind.of, quantities)[order]),
        )


def _legs(obs: Observations, usable: Sequence[int]) -> list[tuple[int, int]]:
    """Return pairs of stretches at one set point, reached from a colder and from a warmer one."""
    found = []
    for one in usable:
        for other in usable:
            heated, cooled = obs.stretches[one], obs.stretches[other]
            same = abs(heated.setpoint_c - cooled.setpoint_c) < SAME_C
            if same and heated.before_c < heated.setpoint_c and cooled.before_c > cooled.setpoint_c:
                found.append((one, other))
    return found


def _memories(obs: Observations, pairs: Sequence[tuple[int, int]]) -> Iterator[Measured]:
    numbers = sorted({number for pair in pairs for number in pair})
    points, chosen = _together(obs, numbers)
    heated, cooled = (np.array([numbers.index(pair[side]) for pair in pairs]) for side in (0, 1))
    celsius = np.array([obs.stretches[one].setpoint_c for one, _ in pairs])
    quantities = obs.quantities(points)
    for kind in _kinds(obs, points, chosen):
        name = f"hysteresis_temperature_{'scale' if kind.name == 'scale_factor' else 'bias'}"
        if kind.name == "scale_factor" and _rates(points) < _FEWEST_RATES:
            yield refused(name, message("needs_rates", found=_rates(points), needed=_FEWEST_RATES))
            continue

        def apart(offsets: Offsets, kind: _Kind = kind) -> FloatArray:
            found = kind.of(offsets)
            return kind.apart(found[:, heated], found[:, cooled])

        table = (
            column("temperature", "degC", celsius),
            column("heated_less_cooled", UNITS[name], as_read(apart, quantities)),
        )
        yield measured(
            name,
            *largest_of(apart, quantities),
            points,
            table=table,
            picture=dots(*table, standard=standards(apart, quantities), limited="y"),
        )
