"""Misalignment: the angle between the input axis and the plane perpendicular to the table's axis.

The unit is mounted across; δ = (F₊ − F₋)/(2·K·Ω), here the slope of the line over all rates divided by the scale
factor. The fixture's error is included in it and in the budget.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchctl.metrology.observations import Observations, column, measured, refused
from benchctl.metrology.points import line
from benchctl.metrology.propagation import Offsets, as_read, propagated, single
from benchctl.metrology.result import Measured, message
from benchctl_instruments.arrays import FloatArray

_NAME = "misalignment"


def across_tests(obs: Observations) -> Iterator[Measured]:
    """Yield the misalignment."""
    across = [number for number, stretch in enumerate(obs.stretches) if stretch.across]
    turned = [one for one in across if np.unique(obs.in_stretch(one).set_dps).size > 1]
    if not turned:
        yield refused(_NAME, message("needs_across"))
        return
    if obs.reference is None:
        yield refused(_NAME, message("needs_scale_factor"))
        return
    where = turned[0]
    points = obs.swept_in([obs.reference, where])
    own, sweep = points.stretch == where, points.stretch == obs.reference

    def milliradians(offsets: Offsets) -> FloatArray:
        rate_dps, output_v = points.moved(offsets)
        scale = line(rate_dps[:, sweep], output_v[:, sweep])[0]
        felt = line(rate_dps[:, own], output_v[:, own])[0] / scale
        # a unit that was not mounted across senses the full rate
        return np.asarray(1e3 * (np.arcsin(np.clip(felt, -1.0, 1.0)) + offsets["fixture"][:, 0]))

    fixture = single("fixture", float(np.deg2rad(obs.stated.mounting_deg.standard)), obs.stated.mounting_deg.says)
    quantities = [*obs.quantities(points), fixture]
    yield measured(
        _NAME,
        float(as_read(milliradians, quantities)),
        propagated(milliradians, quantities),
        points.of(own),
        table=(column("rate", "deg/s", points.rate_dps[own]), column("output", "V", points.output_v[own])),
    )
