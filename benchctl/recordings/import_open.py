"""Read an open recording: a folder with `recording.json` and `samples.csv.gz` (or `samples.csv`).

Every error is one line with the file, the line and the column, or the key; nothing is guessed. What the format does not
define is kept: further columns as channels of the same name, further keys in `Meta.extra["foreign_keys"]` (under
`recording`, `unit`, `bench`, and under `steps` by the index of the step), the order of the columns in `csv_columns`,
the number of their printed decimals in `csv_decimals`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from benchctl.documents import json_document
from benchctl.limits import MOST_COUNTS_PER_REV, cut, listed, shown
from benchctl.recordings.model import UNITS, BenchFacts, Meta, Step, Unit
from benchctl.recordings.stamps import StampError, require_uniform
from benchctl.recordings.step_entries import Rate, StepEntry, cut_into_steps
from benchctl.recordings.text_file import (
    Layout,
    body_of,
    header_names,
    printed_decimals,
    read_bytes,
    read_columns,
    read_json_text,
    sources_json,
)
from benchctl.recordings.units import unit_of_column
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.field_faults import field_fault

COLUMNS = ("time_s", "encoder_deg", "gyro_v", "gyro_temp_c", "chamber_temp_c")
"""The columns that every open recording has."""

OPEN_DESCRIPTION = "recording.json"

_LAYOUT = Layout()


class _Table(BaseModel):
    model_config = ConfigDict(strict=True, extra="allow", frozen=True, allow_inf_nan=False, protected_namespaces=())


class _Unit(_Table):
    serial: str
    range_dps: float = Field(ge=0)
    model: str = ""


class _Bench(_Table):
    sample_rate_hz: Rate
    encoder_counts_per_rev: int = Field(ge=0, le=MOST_COUNTS_PER_REV)
    adc_bits: int = Field(ge=0, le=64)
    adc_range_v: float = Field(ge=0)
    latitude_deg: float | None = Field(ge=-90, le=90)


class _Simulation(_Table):
    K0_v_per_dps: float
    U0_v: float
    T0_c: float
    k_T: list[float]  # noqa: N815 - the key is the format's
    k_omega: list[float]
    noise_v_rms: float = Field(ge=0)
    output_limit_v: float = Field(gt=0)


class _OpenStep(StepEntry):
    t_start: float
    t_end: float
    chamber_setpoint_c: float | None


class _Recording(_Table):
    format: Literal["open-recording/1"]
    unit: _Unit
    bench: _Bench
    simulation: _Simulation | None
    steps: list[_OpenStep]


@dataclass(frozen=True, slots=True, kw_only=True)
class Description:
    """The content of `recording.json`; `foreign_keys` are those that the format does not define, by their place."""

    unit: Unit
    bench: BenchFacts
    simulation: Mapping[str, Any] | None
    steps: tuple[StepEntry, ...]
    foreign_keys: Mapping[str, Any]


def read_open_recording(folder: Path) -> tuple[Meta, list[Step]]:
    """Read an open recording into memory.

    Raises
    ------
    UsageError
        One line with the file and the line and column, or the key, at fault.
    """
    description = read_description(folder)
    path = samples_of(folder)
    text = read_bytes(path)
    names = header_names(path, text, _LAYOUT)
    for column in COLUMNS:
        if column not in names:
            raise UsageError(
                f"{path}, line 1: the column {column} is missing among {listed(names)}; "
                "where it has another name or unit, name it in a map file (--map)"
            )
    columns = read_columns(path, text, _LAYOUT, {name: k for k, name in enumerate(names)}, width=len(names))
    decimals = printed_decimals(body_of(path, text, _LAYOUT), names)
    _check_stamps(path, columns["time_s"], description.bench.sample_rate_hz, decimals)
    _check_angle(path, columns["encoder_deg"])
    steps = cut_into_steps(
        description.steps,
        columns,
        rate_hz=description.bench.sample_rate_hz,
        where=lambda k: f"{folder / OPEN_DESCRIPTION}, steps[{k}]",
    )
    extra: dict[str, Any] = {"csv_columns": list(names), "csv_decimals": decimals}
    if others := {name: unit_of_column(name) for name in names if name not in UNITS}:
        extra["channel_units"] = others
    if foreign := foreign_keys(description, steps):
        extra["foreign_keys"] = foreign
    meta = Meta(
        status="imported",
        unit=description.unit,
        bench=description.bench,
        provenance={
            "sources": sources_json([folder / OPEN_DESCRIPTION, path]),
            "treatment": "samples as they stand; stamps checked against the uniform rate",
        },
        simulation=description.simulation,
        extra=extra,
    )
    return meta, steps


def read_description(folder: Path) -> Description:
    """Read `recording.json`.

    Raises
    ------
    UsageError
        It cannot be read, is not JSON, lacks a key, or a key has the wrong type or value.
    """
    path = folder / OPEN_DESCRIPTION
    raw = json_document(read_json_text(path), str(path))
    try:
        found = _Recording.model_validate(raw)
    except ValidationError as err:
        raise UsageError(f"{path}: {first_fault(err)}") from err
    foreign: dict[str, Any] = {
        "recording": dict(found.model_extra or {}),
        "unit": dict(found.unit.model_extra or {}),
        "bench": dict(found.bench.model_extra or {}),
    }
    bench = found.bench
    return Description(
        unit=Unit(serial=found.unit.serial, range_dps=found.unit.range_dps, model=found.unit.model),
        bench=BenchFacts(
            sample_rate_hz=bench.sample_rate_hz,
            encoder_counts_per_rev=bench.encoder_counts_per_rev,
            adc_bits=bench.adc_bits,
            adc_range_v=bench.adc_range_v,
            latitude_deg=bench.latitude_deg,
        ),
        simulation=raw["simulation"],
        steps=tuple(found.steps),
        foreign_keys=foreign,
    )


def foreign_keys(description: Description, steps: Sequence[Step]) -> dict[str, Any]:
    """Return the keys that the format does not define, by their place; those of a step under its index as text."""
    entries = {(entry.name, entry.t_start): entry.unknown_keys for entry in description.steps}
    of_steps = {str(step.info.index): entries.get((step.info.name, step.info.t_start)) for step in steps}
    return {
        place: keys
        for place, keys in {
            **description.foreign_keys,
            "steps": {index: keys for index, keys in of_steps.items() if keys},
        }.items()
        if keys
    }


def samples_of(folder: Path) -> Path:
    """Return the file of samples; raises `UsageError` if there is none, or two."""
    both = [folder / "samples.csv.gz", folder / "samples.csv"]
    there = [path for path in both if path.is_file()]
    if len(there) == 1:
        return there[0]
    if there:
        raise UsageError(f"{folder}: holds samples.csv.gz and samples.csv; keep the one that is meant")
    raise UsageError(f"{folder}: holds neither samples.csv.gz nor samples.csv; an open recording needs one of them")


def first_fault(err: ValidationError) -> str:
    """Return the first error that pydantic found, as `place.of.key: what is wrong`, and the number of further ones."""
    first, *more = err.errors(include_url=False, include_context=False)
    place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"]).lstrip(".")
    rest = f" (and {len(more)} more)" if more else ""
    place = cut(place)
    return f"{place}{': ' if place else ''}{cut(field_fault(first, shown))}{rest}"


def _check_stamps(path: Path, stamps_s: FloatArray, rate_hz: float, decimals: Mapping[str, int]) -> None:
    resolution = 10.0 ** -decimals["time_s"] if "time_s" in decimals else 0.0
    try:
        require_uniform(stamps_s, rate_hz, resolution)
    except StampError as err:
        raise UsageError(
            f"{path}, line {err.row + 2}, column time_s: {err.message}; "
            "correct the stamps, or say in a map file (--map) how to treat them"
        ) from err


def _check_angle(path: Path, angle_deg: FloatArray) -> None:
    beyond = np.flatnonzero((angle_deg < 0) | (angle_deg > 360))
    if beyond.size:
        row = int(beyond[0])
        raise UsageError(
            f"{path}, line {row + 2}, column encoder_deg: {angle_deg[row]:g} is outside 0 to 360; "
            "where it is another unit, or does not wrap, say so in a map file (--map)"
        )
