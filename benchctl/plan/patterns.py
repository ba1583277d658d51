"""Patterns shared by procedures: levels, alternating directions, complete revolutions, zero readings around runs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from benchctl.limits import MOST_STEPS
from benchctl.plan.steps import ConstantRate, Mount, PowerCycle, Role, Sine, Static
from benchctl_instruments.mounting import AXIS_POSITIONS

LONGEST_REVOLUTION_S = 180.0
"""A revolution below 2 °/s takes longer than this; such a rate runs for the requested time only."""

ZERO_EVERY = 4
"""Number of rates of a cycle between two zero readings, which show the drift of the bias."""


def levels(top: float, count: int) -> tuple[float, ...]:
    """Return `count` evenly spaced levels from top/count to `top`.

    >>> levels(50.0, 5)
    (10.0, 20.0, 30.0, 40.0, 50.0)
    """
    _require_count(count)
    return tuple(top * (i + 1) / count for i in range(count))


def set_points(coldest_c: float, hottest_c: float, count: int) -> tuple[float, ...]:
    """Return `count` evenly spaced temperatures, both ends included, rounded to a hundredth of a degree.

    >>> set_points(-40.0, 60.0, 3)
    (-40.0, 10.0, 60.0)
    """
    _require_count(count)
    if count == 1:
        return (coldest_c,)
    return tuple(round(coldest_c + (hottest_c - coldest_c) * i / (count - 1), 2) for i in range(count))


def _require_count(count: int) -> None:
    if not 1 <= count <= MOST_STEPS:
        raise ValueError(f"expected a count of 1 to {MOST_STEPS}, got {count}")


def alternating(rates_dps: Iterable[float]) -> tuple[float, ...]:
    """Return both directions of every rate, alternating, so that a drift is not mistaken for an asymmetry.

    >>> alternating([10.0, 20.0])
    (10.0, -10.0, 20.0, -20.0)
    """
    return tuple(sign * rate for rate in rates_dps for sign in (1, -1))


def whole_revolutions(rate_dps: float, at_least_s: float) -> float:
    """Return the shortest time [s], at least `at_least_s`, in which the table makes complete revolutions.

    >>> whole_revolutions(50.0, 30.0)
    36.0
    """
    if abs(rate_dps) * LONGEST_REVOLUTION_S < 360.0:
        return at_least_s
    return math.ceil(at_least_s * abs(rate_dps) / 360.0 - 1e-9) * 360.0 / abs(rate_dps)


def whole_cycles(frequency_hz: float, at_least_s: float) -> int:
    """Return the smallest number of complete periods, at least one, that lasts `at_least_s` or longer.

    >>> whole_cycles(0.4, 30.0)
    12
    """
    return max(1, math.ceil(at_least_s * frequency_hz - 1e-9))


def rates_between_zeros(
    rates_dps: Iterable[float], *, at_least_s: float, zero_s: float, settle_s: float = 2.0, role: Role = "fit"
) -> Iterator[Static | ConstantRate]:
    """Yield a zero reading, every rate in both directions over complete revolutions, and a second zero reading."""
    yield Static(duration_s=zero_s, settle_s=settle_s, role=role)
    for rate_dps in alternating(rates_dps):
        yield ConstantRate(
            rate_dps=rate_dps, duration_s=whole_revolutions(rate_dps, at_least_s), settle_s=settle_s, role=role
        )
    yield Static(duration_s=zero_s, settle_s=settle_s, role=role)


def rate_cycle(
    rates_dps: Iterable[float], *, at_least_s: float, zero_s: float, settle_s: float = 2.0
) -> Iterator[Static | ConstantRate]:
    """Yield increasing, then decreasing rates in one direction, then in the other, with zero readings in between.

    This shows the hysteresis of the output in rate. The first and the last step are zero readings.
    """
    up = tuple(rates_dps)
    for sign in (1, -1):
        yield Static(duration_s=zero_s, settle_s=settle_s)
        for number, rate_dps in enumerate((*up, *up[-2::-1]), 1):
            yield ConstantRate(
                rate_dps=sign * rate_dps, duration_s=whole_revolutions(rate_dps, at_least_s), settle_s=settle_s
            )
            if number % ZERO_EVERY == 0:
                yield Static(duration_s=zero_s, settle_s=settle_s)
    yield Static(duration_s=zero_s, settle_s=settle_s)


def small_steps(
    base_dps: float, steps_dps: Iterable[float], *, run_s: float, settle_s: float = 2.0
) -> Iterator[Static | ConstantRate]:
    """Yield steps of increasing size above and below a base rate, with the base rate before and after each pair."""
    yield _hold(base_dps, run_s, settle_s)
    for step_dps in steps_dps:
        yield ConstantRate(rate_dps=base_dps + step_dps, duration_s=run_s, settle_s=settle_s)
        yield ConstantRate(rate_dps=base_dps - step_dps, duration_s=run_s, settle_s=settle_s)
        yield _hold(base_dps, run_s, settle_s)


def _hold(rate_dps: float, run_s: float, settle_s: float) -> Static | ConstantRate:
    if rate_dps == 0.0:
        return Static(duration_s=run_s, settle_s=settle_s)
    return ConstantRate(rate_dps=rate_dps, duration_s=run_s, settle_s=settle_s)


def slow_swing(amplitude_dps: float, frequency_hz: float, cycles: int) -> Sine:
    """Return a sine so slow that the output is quasi-static at every rate."""
    return Sine(amplitude_dps=amplitude_dps, frequency_hz=frequency_hz, cycles=cycles)


def turn_ons(
    rates_dps: Iterable[float], count: int, *, off_s: float, warm_s: float, at_least_s: float, zero_s: float
) -> Iterator[PowerCycle | Static | ConstantRate]:
    """Yield `count` times: unit off, on, warm-up at rest, and a short rate sweep between zero readings."""
    rates = tuple(rates_dps)
    for _ in range(count):
        yield PowerCycle(off_s=off_s)
        yield Static(duration_s=warm_s)
        yield from rates_between_zeros(rates, at_least_s=at_least_s, zero_s=zero_s)


def across(rates_dps: Iterable[float], *, at_least_s: float, zero_s: float) -> Iterator[Mount | Static | ConstantRate]:
    """Yield a mount across the table's axis, rates in both directions between zeros, and a mount along the axis."""
    yield Mount(position="across")
    yield from rates_between_zeros(rates_dps, at_least_s=at_least_s, zero_s=zero_s)
    yield Mount(position="along")


def axis_mounts(*, opposite: bool) -> tuple[Mount, ...]:
    """Return the mounts that turn a unit of three axes so that each is up and, if `opposite`, down; z up is the last.

    >>> [mount.position for mount in axis_mounts(opposite=False)]
    ['x up', 'y up', 'z up']
    """
    return tuple(Mount(position=at) for at in AXIS_POSITIONS if opposite or at.endswith("up"))
