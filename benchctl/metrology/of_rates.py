"""Results of a gyro whose output is a rate in deg/s: the same numbers, in the units of such an output."""

from __future__ import annotations

from dataclasses import replace

from benchctl.metrology.names import RATE_UNITS
from benchctl.metrology.result import Measured
from benchctl.metrology.verdict import Units, column_in, picture_in, scaled

_UNITS: Units = {"V": ("deg/s", 1.0), "mV/(deg/s)": (RATE_UNITS["scale_factor"], 1e-3)}


def of_rates(found: Measured) -> Measured:
    """Return a result with its units, and those of its table and its plot, for an output in deg/s instead of V."""
    unit, factor = _UNITS.get(found.unit, (found.unit, 1.0))
    found = scaled(found, factor, unit)
    return replace(
        found,
        table=tuple(column_in(one, _UNITS) for one in found.table),
        picture=None if found.picture is None else picture_in(found.picture, _UNITS),
    )
