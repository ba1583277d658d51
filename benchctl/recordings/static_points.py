"""Tables of static points: one row per rate, with mean and standard deviation of the gyro's output, without samples.

In a recording they are one step of kind `static_points`. Its `time_s` is the number of the point in the order of the
table (0, 1, …, unit 1), because the times are not recorded. Its channels are `point_rate_dps`, `point_mean_v`, and, if
they are known, `point_std_v`, `point_run`, `point_temp_c`, `point_duration_s`.
"""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchctl.recordings.column_map import ColumnMap, PointsEntry, RawColumns, converted
from benchctl.recordings.mapped import bench_of, unit_of
from benchctl.recordings.model import Meta, Step, StepInfo
from benchctl.recordings.text_file import Layout, header_names, read_bytes
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

KIND = "static_points"

CHANNEL_UNITS = {
    "time_s": "1",
    "point_rate_dps": "degree s-1",
    "point_mean_v": "V",
    "point_std_v": "V",
    "point_run": "1",
    "point_temp_c": "degC",
    "point_duration_s": "s",
}
"""Units of the step's channels; mean and standard deviation of a digital gyro are in degree s-1."""

_CHANNELS = {
    "rate_dps": "point_rate_dps",
    "mean_v": "point_mean_v",
    "std_v": "point_std_v",
    "run": "point_run",
    "temperature_c": "point_temp_c",
    "duration_s": "point_duration_s",
}
"""The channel of each field of `StaticPoints`."""

_BY_NAME = {
    "run": ("run", "1"),
    "rate": ("rate_dps", "deg/s"),
    "mean": ("gyro_v_mean", "V"),
    "std": ("gyro_v_std", "V"),
    "temperature": ("temperature_c", "degC"),
    "duration": ("duration_s", "s"),
}
"""Quantity in a table -> the name of its column and its unit, if the table needs no map."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StaticPoints:
    """Static points, each array of shape (n,), in the order of the table.

    `rate_dps` is the commanded rate, `mean_v` and `std_v` are mean and standard deviation of the output over
    `duration_s`; `std_v` is that of the samples, not of the mean. `run` separates the runs of one table. None: not
    known.
    """

    rate_dps: FloatArray
    mean_v: FloatArray
    std_v: FloatArray | None = None
    run: FloatArray | None = None
    temperature_c: FloatArray | None = None
    duration_s: FloatArray | None = None

    @classmethod
    def from_step(cls, step: Step) -> StaticPoints:
        """Return the points of a step of kind `static_points`."""
        return cls(**{field: step.channels[name] for field, name in _CHANNELS.items() if name in step.channels})

    def to_step(self, index: int = 1) -> Step:
        """Return the points as a step."""
        count = self.rate_dps.size
        channels = {name: values for field, name in _CHANNELS.items() if (values := getattr(self, field)) is not None}
        info = StepInfo(
            index=index,
            name="static points",
            kind=KIND,
            t_start=0.0,
            t_end=float(count),
            chamber_setpoint_c=math.nan,
            samples=count,
        )
        return Step(info, {"time_s": np.arange(count, dtype=np.float64), **channels})


def points_of(raw: RawColumns, entry: PointsEntry) -> StaticPoints:
    """Return static points from mapped columns.

    Raises
    ------
    UsageError
        A standard deviation below zero, or fewer than two different rates.
    """
    values = {
        name: converted(raw, name, column)
        for name in ("rate", "mean", "std", "run", "temperature", "duration")
        if (column := getattr(entry, name)) is not None
    }
    if "std" in values and (below := np.flatnonzero(values["std"] < 0)).size:
        raise UsageError(
            f"{raw.place(int(below[0]), 'std')}: a standard deviation below 0, expected 0 or more; "
            "correct the column or its sign"
        )
    if np.unique(values["rate"]).size < 2:
        raise UsageError(f"{raw.path}: all points are at one rate; a calibration needs two at least")
    duration = values.get("duration")
    if duration is None and entry.duration_s is not None:
        duration = np.full(values["rate"].size, entry.duration_s)
    return StaticPoints(
        rate_dps=values["rate"],
        mean_v=values["mean"],
        std_v=values.get("std"),
        run=values.get("run"),
        temperature_c=values.get("temperature"),
        duration_s=duration,
    )


def build_points(raw: RawColumns, mapping: ColumnMap, map_name: str) -> tuple[Meta, list[Step]]:
    """Return a recording of static points in memory; raises `UsageError` if points or unit cannot be used."""
    if mapping.points is None:
        raise UsageError(f"{map_name}: maps no points, expected [points.…]")
    step = points_of(raw, mapping.points).to_step()
    digital = mapping.points.mean.conversion.cf != "V"
    output = dict.fromkeys(("point_mean_v", "point_std_v"), "degree s-1") if digital else {}
    meta = Meta(
        status="imported",
        unit=unit_of(mapping, None, map_name),
        bench=bench_of(mapping, None, mapping.bench.sample_rate_hz),
        provenance={"treatment": f"{step.info.samples} static points; time_s is the number of the point"},
        extra={
            "channel_units": {name: unit for name, unit in (CHANNEL_UNITS | output).items() if name in step.channels},
            "gyro_output_unit": "deg/s" if digital else "V",
            **({} if mapping.points.samples is None else {"samples_per_point": mapping.points.samples}),
        },
    )
    return meta, [step]


def map_by_header(path: Path) -> ColumnMap | None:
    """Return the map for a table of static points with `rate_dps` and `gyro_v_mean` in its header; None for others.

    The unit's serial is the one value of a column `unit`, or the file's name; its rated range is not known (0).
    """
    text = read_bytes(path)
    layout = Layout()
    names = header_names(path, text, layout)
    if not {"rate_dps", "gyro_v_mean"} <= set(names):
        return None
    columns = {entry: {"column": column, "unit": unit} for entry, (column, unit) in _BY_NAME.items() if column in names}
    serial = _one_value(text, names, "unit") or path.name.split(".")[0]
    return ColumnMap.model_validate({"unit": {"serial": serial}, "points": columns})


def _one_value(text: bytes, names: Sequence[str], column: str) -> str | None:
    """Return the value that a column has in every row; None if it does not exist or has different values."""
    if column not in names:
        return None
    k = names.index(column)
    values: set[str] = set()
    for line in itertools.islice(io.BytesIO(text), 1, None):
        cells = line.decode("latin-1").split(",")
        if len(cells) > k:
            values.add(cells[k].strip())
        if len(values) > 1:
            return None
    return values.pop() if values else None
