"""Scale factor, its nonlinearity by two definitions, asymmetry, input range and hysteresis, from the sweep of rates.

Definitions: K is the slope of the least-squares line over all rates; nonlinearity is the largest misfit of that line
over the largest output; nonlinearity of reading is the largest deviation from the line fitted at low rates, over the
reading of that line; asymmetry is the difference of the slopes in both directions over their mean.

Hysteresis in rate is the largest difference of outputs at one rate, reached from below and from above, over the largest
output of the cycle. A cycle goes up to the top rate and down again, in each direction.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchctl.metrology.observations import Observations, both_directions, column, dots, measured, refused
from benchctl.metrology.points import DOWN, UP, Points, line, misfit
from benchctl.metrology.propagation import Offsets, Quantity, as_read, largest_of, propagated, single, standards
from benchctl.metrology.result import Measured, Picture, Trace, message
from benchctl_instruments.arrays import FloatArray, IntArray

_FEWEST = 3
_NAMES = ("scale_factor", "nonlinearity", "nonlinearity_reading", "asymmetry", "input_range")
_LOWEST_SHARE = 0.2
"""Minimum rate for errors of reading, as a share of the limit of low rates; below it the output is mostly bias."""


def scale_factor_tests(obs: Observations) -> Iterator[Measured]:
    """Yield the five results of the reference's sweep."""
    points = obs.at_reference
    if points is None:
        rates = int(np.unique(obs.points.set_dps).size)
        yield from (refused(name, message("needs_rates", found=rates, needed=_FEWEST)) for name in _NAMES)
        return
    quantities = obs.quantities(points)
    yield _scale_factor(obs, points, quantities)
    yield _nonlinearity(points, quantities)
    low = np.abs(points.set_dps) <= obs.settings.low_rate_dps
    if int(low.sum()) < _FEWEST or not (np.abs(points.set_dps) > _LOWEST_SHARE * obs.settings.low_rate_dps).any():
        why = message("needs_rates", found=int(low.sum()), needed=_FEWEST)
        yield from (refused(name, why) for name in ("nonlinearity_reading", "input_range"))
    else:
        yield _of_reading(obs, points, quantities)
        yield _input_range(obs, points, quantities)
    if both_directions(points):
        yield _asymmetry(points, quantities)
    else:
        yield refused("asymmetry", message("needs_both_directions"))


def _scale_factor(obs: Observations, points: Points, quantities: list[Quantity]) -> Measured:
    warmth = single("thermometer", obs.stated.thermometer_c.standard, obs.stated.thermometer_c.says)
    per_c = _slope_per_c(obs)

    def millivolts(offsets: Offsets) -> FloatArray:
        warmer = 1.0 + per_c * offsets["thermometer"][:, 0]
        return 1e3 * line(*points.moved(offsets))[0] * warmer

    every = [*quantities, warmth]
    left = misfit(points.rate_dps[None], points.output_v[None])[0]
    order = np.argsort(points.rate_dps)
    return measured(
        "scale_factor",
        float(as_read(millivolts, every)),
        propagated(millivolts, every),
        points,
        table=(
            column("rate", "deg/s", points.rate_dps),
            column("output", "V", points.output_v),
        ),
        picture=Picture(
            x="rate",
            x_unit="deg/s",
            y="output",
            y_unit="V",
            traces=(
                Trace(label="readings", x=points.rate_dps, y=points.output_v),
                Trace(label="line", x=points.rate_dps[order], y=(points.output_v - left)[order], dots=False),
            ),
        ),
    )


def _slope_per_c(obs: Observations) -> float:
    """Return the relative change of K with temperature, 1/°C, from stretches at other temperatures; 0 if none."""
    found = []
    for number, stretch in enumerate(obs.stretches):
        points = obs.swept_in([number])
        enough = np.unique(points.set_dps).size >= _FEWEST
        if not stretch.across and enough and np.isfinite(stretch.temperature_c):
            found.append((stretch.temperature_c, float(np.polyfit(points.rate_dps, points.output_v, 1)[0])))
    if not found or np.ptp(found, axis=0)[0] < 5.0:
        return 0.0
    celsius, slopes = np.array(found).T
    return float(np.polyfit(celsius, slopes / slopes.mean(), 1)[0])


def _nonlinearity(points: Points, quantities: list[Quantity]) -> Measured:
    def ppm(offsets: Offsets) -> FloatArray:
        rate_dps, output_v = points.moved(offsets)
        slope, intercept = line(rate_dps, output_v)
        above = output_v - intercept[:, None]
        return np.asarray(1e6 * (above - slope[:, None] * rate_dps) / np.max(np.abs(above), axis=1, keepdims=True))

    table = column("rate", "deg/s", points.rate_dps), column("misfit", "ppm", as_read(ppm, quantities))
    return measured(
        "nonlinearity",
        *largest_of(ppm, quantities),
        points,
        table=table,
        picture=dots(*table, standard=standards(ppm, quantities), limited="y"),
    )


def _reading_errors(points: Points, offsets: Offsets, low: IntArray, high: IntArray) -> FloatArray:
    """Return deviations from the line at low rates over its reading, percent, shape (d, n of high)."""
    rate_dps, output_v = points.moved(offsets)
    slope, intercept = line(rate_dps[:, low], output_v[:, low])
    reads = slope[:, None] * rate_dps[:, high]
    return np.asarray(100.0 * (output_v[:, high] - intercept[:, None] - reads) / reads)


def _ranges(obs: Observations, points: Points) -> tuple[IntArray, IntArray]:
    """Return the points to which the line at low rates is fitted, and those that are compared with it."""
    limit_dps = obs.settings.low_rate_dps
    absolute = np.abs(points.set_dps)
    return np.flatnonzero(absolute <= limit_dps), np.flatnonzero(absolute > _LOWEST_SHARE * limit_dps)


def _of_reading(obs: Observations, points: Points, quantities: list[Quantity]) -> Measured:
    low, high = _ranges(obs, points)

    def percent(offsets: Offsets) -> FloatArray:
        return _reading_errors(points, offsets, low, high)

    errors = as_read(percent, quantities)
    table = column("rate", "deg/s", points.rate_dps[high]), column("error_of_reading", "%", errors)
    return measured(
        "nonlinearity_reading",
        *largest_of(percent, quantities),
        points,
        notes=(message("line_up_to", limit_dps=obs.settings.low_rate_dps),),
        table=table,
        picture=dots(*table, standard=standards(percent, quantities), limited="y"),
    )


def _input_range(obs: Observations, points: Points, quantities: list[Quantity]) -> Measured:
    """Return the rate at which the largest error of reading of all visits passes the limit, interpolated linearly."""
    low, high = _ranges(obs, points)
    limit = obs.settings.linearity_percent
    sizes = np.abs(points.set_dps[high])
    visits = [sizes == size for size in np.unique(sizes)]

    def largest(offsets: Offsets) -> FloatArray:
        errors = np.abs(_reading_errors(points, offsets, low, high))
        return np.maximum.accumulate(np.stack([errors[:, own].max(axis=1) for own in visits], axis=1), axis=1)

    def reached(offsets: Offsets) -> FloatArray:
        rates = np.abs(points.moved(offsets)[0][:, high])
        return _first_crossing(
            np.stack([rates[:, own].mean(axis=1) for own in visits], axis=1), largest(offsets), limit
        )

    found = as_read(largest, quantities)
    return measured(
        "input_range",
        float(as_read(reached, quantities)),
        propagated(reached, quantities),
        points,
        notes=(message("within_linearity", percent=limit),),
        bound="at least" if found[-1] <= limit else "at most" if found[0] > limit else "",
    )


def _first_crossing(rates: FloatArray, errors: FloatArray, limit: float) -> FloatArray:
    """Return where increasing errors (d, n) over rates (d, n) pass the limit; the last rate if they never do; (d,)."""
    beyond = errors > limit
    first = np.where(beyond.any(axis=1), np.argmax(beyond, axis=1), rates.shape[1] - 1)
    rows, before = np.arange(rates.shape[0]), np.maximum(first - 1, 0)
    rise = errors[rows, first] - errors[rows, before]
    share = np.divide(limit - errors[rows, before], rise, out=np.ones_like(rise), where=rise > 0.0)
    crossing = rates[rows, before] + np.clip(share, 0.0, 1.0) * (rates[rows, first] - rates[rows, before])
    return np.where(beyond.any(axis=1), crossing, rates[:, -1])


def _asymmetry(points: Points, quantities: list[Quantity]) -> Measured:
    forward, backward = (np.flatnonzero(sign * points.set_dps > 0.0) for sign in (1.0, -1.0))

    def ppm(offsets: Offsets) -> FloatArray:
        rate_dps, output_v = points.moved(offsets)
        plus, minus = (line(rate_dps[:, side], output_v[:, side])[0] for side in (forward, backward))
        return np.asarray(2e6 * (plus - minus) / (plus + minus))[:, None]

    return measured("asymmetry", *largest_of(ppm, quantities), points)


_HYSTERESIS = "hysteresis_rate"


def hysteresis_tests(obs: Observations) -> Iterator[Measured]:
    """Yield the hysteresis in rate."""
    points, up, down = _widest_cycle(obs)
    if up.size == 0:
        yield refused(_HYSTERESIS, message("needs_up_and_down"))
        return
    slope = obs.scale_v_per_dps
    largest_v = float(np.max(np.abs(slope * points.set_dps)))

    def differences(offsets: Offsets) -> FloatArray:
        rate_dps, output_v = points.moved(offsets)
        at_set = output_v - slope * (rate_dps - points.set_dps)  # the table never repeats a rate exactly
        return np.asarray(1e6 * (at_set[:, up] - at_set[:, down]) / largest_v)

    quantities = obs.quantities(points)
    found = as_read(differences, quantities)
    table = column("rate", "deg/s", points.set_dps[up]), column("up_less_down", "ppm", found)
    yield measured(
        _HYSTERESIS,
        *largest_of(differences, quantities),
        points,
        table=table,
        picture=dots(*table, standard=standards(differences, quantities), limited="y"),
    )


def _widest_cycle(obs: Observations) -> tuple[Points, np.ndarray, np.ndarray]:
    """Return the stretch with the highest rate reached from both sides, and its pairs of points, up and down."""
    best = obs.points.of(np.zeros(0, dtype=np.int64)), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    reached = 0.0
    for number, stretch in enumerate(obs.stretches):
        points = obs.in_stretch(number)
        pairs = _pairs(points)
        top = max((abs(float(points.set_dps[one])) for one, _ in pairs), default=0.0)
        if not stretch.across and top > reached:
            up, down = (np.array([pair[side] for pair in pairs], dtype=np.int64) for side in (0, 1))
            best, reached = (points, up, down), top
    return best


def _pairs(points: Points) -> list[tuple[int, int]]:
    risen = {float(points.set_dps[k]): int(k) for k in np.flatnonzero(points.leg == UP)[::-1]}
    fallen = {float(points.set_dps[k]): int(k) for k in np.flatnonzero(points.leg == DOWN)[::-1]}
    return [(risen[rate], fallen[rate]) for rate in sorted(risen.keys() & fallen.keys())]
