"""Hysteresis in rate: the largest difference of outputs at one rate, reached from below and from above.

Over the largest output of the cycle. A cycle goes up to the top rate and down again, in each direction.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchctl.metrology.observations import Observations, column, dots, measured, refused
from benchctl.metrology.points import DOWN, UP, Points
from benchctl.metrology.propagation import Offsets, as_read, largest_of
from benchctl.metrology.result import Measured, message
from benchctl_instruments.arrays import FloatArray

_NAME = "hysteresis_rate"


def hysteresis_tests(obs: Observations) -> Iterator[Measured]:
    """The one result."""
    points, up, down = _widest_cycle(obs)
    if up.size == 0:
        yield refused(_NAME, message("needs_up_and_down"))
        return
    slope = obs.scale_v_per_dps
    largest_v = float(np.max(np.abs(slope * points.set_dps)))

    def differences(offsets: Offsets) -> FloatArray:
        rate_dps, output_v = points.moved(offsets)
        at_set = output_v - slope * (rate_dps - points.set_dps)  # the table never turns twice at the very same rate
        return np.asarray(1e6 * (at_set[:, up] - at_set[:, down]) / largest_v)

    quantities = obs.quantities(points)
    found = as_read(differences, quantities)
    table = column("rate", "deg/s", points.set_dps[up]), column("up_less_down", "ppm", found)
    yield measured(
        _NAME,
        *largest_of(differences, quantities),
        points,
        table=table,
        picture=dots(*table),
    )


def _widest_cycle(obs: Observations) -> tuple[Points, np.ndarray, np.ndarray]:
    """The stretch whose rates, reached from both sides, go furthest; and which of its points pair, up with down."""
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
