"""Columns of a foreign file as they stand, before units and clocks, and how a place in them is said."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchctl.recordings.column_map import Column, ColumnMap
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

TIME = "time_s"
"""The name under which the column of stamps is kept among the channels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """A column that the map asks for: a name, or a number from 1, and the column of a matrix where it is one."""

    column: str | int
    index: int | None = None

    def __str__(self) -> str:
        return f"{self.column}" if self.index is None else f"{self.column}[{self.index}]"


@dataclass(frozen=True, slots=True, kw_only=True)
class RawColumns:
    """Channel -> numbers as the file has them, each of shape (rows,); the first is the file's own `first_row`."""

    path: Path
    values: Mapping[str, FloatArray]
    wanted: Mapping[str, Wanted]
    first_row: int
    row_word: str

    def place(self, row: int, channel: str) -> str:
        """Where a value stands: file, line and column; `row` counts from 0."""
        return f"{self.path}, {self.row_word} {row + self.first_row}, column {self.wanted[channel]}"

    def require_finite(self) -> None:
        """Raise `UsageError` at the first value that is not a finite number."""
        for channel, values in self.values.items():
            odd = np.flatnonzero(~np.isfinite(values))
            if odd.size:
                raise UsageError(
                    f"{self.place(int(odd[0]), channel)}: expected a finite number, got {values[odd[0]]}; "
                    "leave such rows out"
                )


def converted(raw: RawColumns, channel: str, entry: Column) -> FloatArray:
    """A column in the unit of its channel, shape (rows,); raises `UsageError` where scale and offset overflow it."""
    with np.errstate(over="ignore", invalid="ignore"):
        values = entry.conversion.apply(raw.values[channel])
    odd = np.flatnonzero(~np.isfinite(values))
    if odd.size:
        raise UsageError(
            f"{raw.place(int(odd[0]), channel)}: {raw.values[channel][odd[0]]} becomes {values[odd[0]]}; "
            "correct unit, scale and offset in the map file"
        )
    return values


def wanted_columns(mapping: ColumnMap) -> dict[str, Wanted]:
    """The columns that a map asks for, by channel; the stamps, where they are a column, as `time_s`."""
    found: dict[str, Wanted] = {}
    if mapping.time is not None and mapping.time.column is not None:
        found[TIME] = Wanted(column=mapping.time.column, index=mapping.time.index)
    if mapping.channels is not None:
        for name, entry in mapping.channels.columns.items():
            found[name] = Wanted(column=entry.column, index=entry.index)
    if mapping.points is not None:
        for name in ("rate", "mean", "std", "run", "temperature", "duration"):
            if (point := getattr(mapping.points, name)) is not None:
                found[name] = Wanted(column=point.column, index=point.index)
    return found
