"""Results of a gyro whose output is a rate in deg/s: the same numbers, in the units of such an output."""

from __future__ import annotations

from dataclasses import replace

from benchctl.metrology.names import RATE_UNITS
from benchctl.metrology.result import Column, Measured, Picture
from benchctl.metrology.verdict import scaled

_UNITS = {"V": ("deg/s", 1.0), "mV/(deg/s)": (RATE_UNITS["scale_factor"], 1e-3)}
"""Unit of an output in volts -> the unit of one in deg/s, and the factor of the numbers."""


def of_rates(found: Measured) -> Measured:
    """Return a result with its units, and those of its table and its plot, for an output in deg/s instead of V."""
    unit, factor = _UNITS.get(found.unit, (found.unit, 1.0))
    return replace(
        scaled(found, factor, unit),
        table=tuple(_column(one) for one in found.table),
        picture=None if found.picture is None else _picture(found.picture),
    )


def _column(column: Column) -> Column:
    unit, factor = _UNITS.get(column.unit, (column.unit, 1.0))
    return replace(column, unit=unit, values=tuple(factor * value for value in column.values))


def _picture(picture: Picture) -> Picture:
    x_unit, along = _UNITS.get(picture.x_unit, (picture.x_unit, 1.0))
    y_unit, up = _UNITS.get(picture.y_unit, (picture.y_unit, 1.0))
    left_unit, down = _UNITS.get(picture.left_unit, (picture.left_unit, 1.0))

    return replace(
        picture,
        x_unit=x_unit,
        y_unit=y_unit,
        left_unit=left_unit,
        traces=tuple(replace(one, x=along * one.x, y=up * one.y) for one in picture.traces),
        left=tuple(replace(one, x=along * one.x, y=down * one.y) for one in picture.left),
    )
