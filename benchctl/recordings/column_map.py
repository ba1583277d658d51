"""The map file, checked by pydantic, and the columns of a foreign file that it selects.

The map states which column is which channel, in which unit, with which sign; `map_examples` explains it by example. The
columns are kept unconverted, before units and clocks are applied.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from benchctl.limits import MOST_COLUMNS, MOST_COUNTS_PER_REV, MOST_HEADER_LINES
from benchctl.recordings import units
from benchctl.recordings.step_entries import Rate, StepEntry
from benchctl.toml_file import parse_toml, read_text
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

ColumnName = Annotated[str, Field(min_length=1)] | Annotated[int, Field(ge=1, le=MOST_COLUMNS)]

_RESERVED = re.compile(r"poll_.*|time_s|filled|point_.*")
_NAME = re.compile(r"[a-z][a-z0-9_]*")


def _known_in(table: Mapping[str, units.Conversion], *further: str) -> AfterValidator:
    def check(unit: str) -> str:
        if unit not in table and unit not in further:
            raise ValueError(f"the unit {unit!r} is not known here; known are {', '.join([*table, *further])}")
        return unit

    return AfterValidator(check)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, protected_namespaces=())


class Column(_Table):
    """Where values are and what they become: `sign · scale · (value in the channel's unit) + offset`.

    `column` is a name, or a number from 1; `index` is the column of a matrix in a MAT file, from 1.
    """

    known: ClassVar[Mapping[str, units.Conversion]] = {}

    column: ColumnName
    index: int | None = Field(default=None, ge=1, le=MOST_COLUMNS)
    unit: str
    sign: Literal[1, -1] = 1
    scale: float = 1.0
    offset: float = 0.0

    @property
    def conversion(self) -> units.Conversion:
        """The conversion of a value in the file to the channel's unit, with sign, scale and offset."""
        unit = self.unit_conversion
        factor = self.sign * self.scale
        return units.Conversion(unit.cf, factor * unit.factor, factor * unit.offset + self.offset, unit.divisor)

    @property
    def unit_conversion(self) -> units.Conversion:
        """The conversion of the unit alone."""
        return self.known[self.unit]

    @property
    def channel_unit(self) -> str:
        """The unit of the channel, in CF spelling."""
        return self.unit_conversion.cf


class AngleColumn(Column):
    """The angle of the table; the sign is -1 if it counts clockwise.

    Where the file has the encoder's rate instead, in a unit of rate, the angle is its sum: each value is the mean rate
    since the row before.
    """

    known: ClassVar[Mapping[str, units.Conversion]] = {**units.ANGLE, **units.RATE}

    unit: Annotated[str, _known_in(units.ANGLE, units.COUNTS, *units.RATE)]
    counts_per_rev: float | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _counts_are_told(self) -> AngleColumn:
        if self.unit == units.COUNTS and self.counts_per_rev is None:
            raise ValueError("an angle in counts needs counts_per_rev")
        return self

    @property
    def channel_unit(self) -> str:
        """The unit of the channel, also where a rate becomes an angle."""
        return "degree"

    @property
    def is_rate(self) -> bool:
        """Whether the file has the rate of the encoder."""
        return self.unit in units.RATE

    @property
    def unit_conversion(self) -> units.Conversion:
        """The conversion of the unit alone; counts are converted by `counts_per_rev`."""
        if self.counts_per_rev is not None and self.unit == units.COUNTS:
            return units.Conversion("degree", 360.0, divisor=self.counts_per_rev)
        return self.known[self.unit]


class OutputColumn(Column):
    """The output of the gyro: volts, or a rate if the gyro is digital."""

    known: ClassVar[Mapping[str, units.Conversion]] = units.GYRO_OUTPUT
    unit: Annotated[str, _known_in(units.GYRO_OUTPUT)]


class TemperatureColumn(Column):
    """A temperature."""

    known: ClassVar[Mapping[str, units.Conversion]] = units.TEMPERATURE
    unit: Annotated[str, _known_in(units.TEMPERATURE)]


class RateColumn(Column):
    """A rate of rotation."""

    known: ClassVar[Mapping[str, units.Conversion]] = units.RATE
    unit: Annotated[str, _known_in(units.RATE)]


class DurationColumn(Column):
    """A time."""

    known: ClassVar[Mapping[str, units.Conversion]] = units.TIME
    unit: Annotated[str, _known_in(units.TIME)]


class OtherColumn(Column):
    """Anything else, kept in its own unit."""

    known: ClassVar[Mapping[str, units.Conversion]] = units.OTHER
    unit: Annotated[str, _known_in(units.OTHER)] = "1"


class Channels(BaseModel):
    """The channels by name; a channel without a benchctl name is an `OtherColumn`."""

    model_config = ConfigDict(extra="allow", frozen=True)
    __pydantic_extra__: dict[str, OtherColumn]

    encoder_deg: AngleColumn | None = None
    gyro_v: OutputColumn | None = None
    gyro_temp_c: TemperatureColumn | None = None
    chamber_temp_c: TemperatureColumn | None = None

    @model_validator(mode="after")
    def _names_can_be_used(self) -> Channels:
        for name in self.__pydantic_extra__:
            if _RESERVED.fullmatch(name) or not _NAME.fullmatch(name):
                raise ValueError(
                    f"a channel cannot be named {name!r}; use small letters, digits and _, "
                    "not time_s, filled, poll_… or point_…"
                )
        if not self.columns:
            raise ValueError("name at least one channel")
        return self

    @property
    def columns(self) -> dict[str, Column]:
        """Name of the channel -> its column."""
        ours: dict[str, Column | None] = {name: getattr(self, name) for name in type(self).model_fields}
        return {name: column for name, column in (ours | self.__pydantic_extra__).items() if column is not None}


class TimeEntry(_Table):
    """The column of the stamps, or the rate of the rows; what to do with stamps that are not uniform."""

    column: ColumnName | None = None
    index: int | None = Field(default=None, ge=1, le=MOST_COLUMNS)
    unit: Annotated[str, _known_in(units.TIME)] = "s"
    rate_hz: Rate | None = None
    stamps: Literal["refuse", "repair", "keep"] = "refuse"
    gaps: Literal["split", "fill"] = "split"

    @model_validator(mode="after")
    def _has_one_source(self) -> TimeEntry:
        if (self.column is None) == (self.rate_hz is None):
            raise ValueError("say either column (of the stamps) or rate_hz (where there are none)")
        return self


class UnitEntry(_Table):
    """The gyro under test."""

    serial: str = Field(min_length=1)
    range_dps: float = Field(default=0.0, ge=0)
    model: str = ""


class BenchEntry(_Table):
    """What is known about the bench; `sample_rate_hz` only if the stamps are to be checked against it."""

    sample_rate_hz: Rate | None = None
    encoder_counts_per_rev: int = Field(default=0, ge=0, le=MOST_COUNTS_PER_REV)
    encoder_accuracy_arcsec: float = Field(default=0.0, ge=0)
    adc_bits: int = Field(default=0, ge=0, le=64)
    adc_range_v: float = Field(default=0.0, ge=0)
    latitude_deg: float | None = Field(default=None, ge=-90, le=90)


class FileEntry(_Table):
    """The layout of the file; lines and rows count from 1. A blank as delimiter is any run of blanks and tabs.

    `table` names the table of an SQLite database, or the place of the table in a JSON document (keys joined by dots);
    `query` is a SELECT that replaces it.
    """

    delimiter: str = Field(default=",", min_length=1, max_length=1)
    decimal: Literal[".", ","] = "."
    header_line: int = Field(default=1, ge=0, le=MOST_HEADER_LINES)
    first_line: int | None = Field(default=None, ge=1, le=1 << 40)
    first_row_variable: str | None = None
    table: str = ""
    query: str = ""

    @model_validator(mode="after")
    def _marks_differ(self) -> FileEntry:
        if self.delimiter in "\r\n":
            raise ValueError("an end of line cannot be the delimiter, expected a mark such as , or ; or a tab")
        if self.delimiter == self.decimal:
            raise ValueError(f"{self.decimal!r} cannot be the delimiter and the decimal mark; say another delimiter")
        return self


class PointsEntry(_Table):
    """A table of static points: one row per rate."""

    rate: RateColumn
    mean: OutputColumn
    std: OutputColumn | None = None
    run: OtherColumn | None = None
    temperature: TemperatureColumn | None = None
    duration: DurationColumn | None = None
    duration_s: float | None = Field(default=None, gt=0)
    samples: int | None = Field(default=None, gt=0, le=1 << 53)


class MapStep(StepEntry):
    """A step that the map lists; a misspelt key is an error here."""

    model_config = ConfigDict(strict=False, extra="forbid")


class ColumnMap(_Table):
    """A map file: channels with their time, or static points.

    `drive` and `chamber` are a lab's models of these parts, for their diagnosis.
    """

    unit: UnitEntry | None = None
    bench: BenchEntry = BenchEntry()
    file: FileEntry = FileEntry()
    time: TimeEntry | None = None
    channels: Channels | None = None
    points: PointsEntry | None = None
    drive: dict[str, float] = {}
    chamber: dict[str, float] = {}
    steps: tuple[MapStep, ...] = ()

    @model_validator(mode="after")
    def _maps_one_thing(self) -> ColumnMap:
        if self.points is not None and (self.channels is not None or self.time is not None or self.steps):
            raise ValueError("[points] excludes other tables: a table of points has no [time], [channels] or [[steps]]")
        if self.points is None and (self.channels is None or self.time is None):
            raise ValueError("say [time] and [channels.…] for a table of samples, or [points.…] for static points")
        return self


def parse_map(text: str, name: str) -> ColumnMap:
    """Parse a map file's text; raises `UsageError` with the file, the line and the field."""
    return parse_toml(text, ColumnMap, name)


def read_map(path: Path) -> tuple[ColumnMap, str]:
    """Return a map file and its text; raises `UsageError` with the file, the line and the field."""
    text = read_text(path, "map file")
    return parse_map(text, str(path)), text


TIME = "time_s"
"""The name of the column of stamps among the channels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """A column that the map selects: a name, or a number from 1, and the column of a matrix if it is one."""

    column: str | int
    index: int | None = None

    def __str__(self) -> str:
        return f"{self.column}" if self.index is None else f"{self.column}[{self.index}]"


@dataclass(frozen=True, slots=True, kw_only=True)
class RawColumns:
    """Channel -> unconverted numbers, each of shape (rows,); the first row is number `first_row` of the file."""

    path: Path
    values: Mapping[str, FloatArray]
    wanted: Mapping[str, Wanted]
    first_row: int
    row_word: str

    def place(self, row: int, channel: str) -> str:
        """Return the place of a value: file, line and column; `row` counts from 0."""
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


def raw_columns(path: Path, columns: Mapping[str, FloatArray], wanted: Mapping[str, Wanted], first: int) -> RawColumns:
    """Return the columns by channel, from row `first` on.

    Raises `UsageError` if they differ in length, have no such row, or contain a number that is not finite.
    """
    lengths = {str(wanted[channel]): column.size for channel, column in columns.items()}
    if len(set(lengths.values())) > 1:
        counted = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise UsageError(f"{path}: the columns have different numbers of rows: {counted}; map those of one length")
    rows = min(lengths.values())
    if first > rows:
        raise UsageError(f"{path}: has {rows} rows, none from row {first}, where the map begins; correct first_line")
    values = {channel: column[first - 1 :] for channel, column in columns.items()}
    raw = RawColumns(path=path, values=values, wanted=wanted, first_row=first, row_word="row")
    raw.require_finite()
    return raw


def converted(raw: RawColumns, channel: str, entry: Column) -> FloatArray:
    """Return a column in its channel's unit, shape (rows,); raises `UsageError` if scale and offset overflow it."""
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
    """Return the columns that a map selects, by channel; the stamps, if they are a column, as `time_s`."""
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
