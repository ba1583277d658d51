"""Read descriptions from the attributes of an HDF5 file, laid out as in `schema`; every attribute is validated.

A user of a description may rely on the types of its fields, and on the types of what `Meta.extra` contains under names
that this program knows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from types import UnionType
from typing import Annotated, Any, TypeVar, cast, get_args, get_type_hints

import h5py
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from benchctl.documents import json_document
from benchctl.limits import LARGEST_WHOLE_NUMBER, cut, shown
from benchctl.recordings.hdf5_guard import attribute, attribute_names, attributes
from benchctl.recordings.model import BenchFacts, Meta, Status, StepInfo, Unit
from benchctl_instruments.field_faults import field_fault

_Description = TypeVar("_Description", StepInfo, Unit, BenchFacts)

_TYPES: Mapping[type, Mapping[str, Any]] = {kind: get_type_hints(kind) for kind in (StepInfo, Unit, BenchFacts)}
"""The types of their fields, resolved once: to resolve them for every step takes a third of its reading time."""

_MOST_DECIMALS = 17
"""Maximum number of decimals; no float64 has more."""

_MAY_BE_UNKNOWN = ("chamber_setpoint_c",)
"""Numbers that may be NaN."""

AXIS_ATTRIBUTES = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST"}
"""Attributes of channels in which HDF5 stores their axes."""
_OWN = {*AXIS_ATTRIBUTES, "digest"}
"""Attributes of a channel that do not describe it."""
_SEALS = {"digest", "manifest"}
"""Attributes of the root and of a step that do not describe them."""


class _Simulation(BaseModel):
    """The model that a lab assumes: any table; its users check its fields (`diagnosis.gyro.model`)."""


class _ForeignKeys(BaseModel):
    model_config = ConfigDict(strict=True)

    recording: dict[str, Any] = {}
    unit: dict[str, Any] = {}
    bench: dict[str, Any] = {}
    steps: dict[str, dict[str, Any]] = {}


class _Extra(BaseModel):
    model_config = ConfigDict(strict=True)

    channel_units: dict[str, str] = {}
    channel_comments: dict[str, str] = {}
    csv_columns: list[str] = Field(default=["time_s"], min_length=1)
    csv_decimals: dict[str, Annotated[int, Field(ge=0, le=_MOST_DECIMALS)]] = {}
    foreign_keys: _ForeignKeys = _ForeignKeys()
    gyro_output_unit: str = "V"


def read_info(group: h5py.Group) -> StepInfo:
    """Return a step's description from the attributes of its group; raises ValueError if they are not valid."""
    known = {item.name for item in fields(StepInfo)}
    found = attributes(group, [name for name in attribute_names(group) if name in known])
    if "whole" not in found:  # without this attribute a step is never assumed to be complete
        raise ValueError("whole is not there")
    return _made(StepInfo, found)


def read_meta(root: h5py.Group) -> Meta:
    """Return the description of a recording from its root; raises ValueError or UsageError if it is not valid."""
    prefixes = ("unit_", "bench_", "provenance_")
    found = attributes(root, [name for name in attribute_names(root) if name.startswith(prefixes)])
    provenance = _part(found, "provenance_")
    for name, value in {**provenance, "status": attribute(root, "status")}.items():
        if not isinstance(value, str):
            raise ValueError(f"{cut(name)} is {shown(value)}, expected text")
    return Meta(
        status=cast(Status, attribute(root, "status")),
        unit=_made(Unit, _part(found, "unit_")),
        bench=_made(BenchFacts, _part(found, "bench_")),
        provenance=provenance,
        simulation=_checked_json(root, "simulation", _Simulation),
        extra=_checked_json(root, "extra", _Extra) or {},
    )


def attributes_of(thing: h5py.Group | h5py.Dataset) -> dict[str, Any]:
    """Return the descriptive attributes as plain values, without seals and HDF5's own bookkeeping.

    An attribute that is neither text nor numbers, which benchctl never writes, is returned as a text that states this.
    """
    found = {}
    excluded = _OWN if isinstance(thing, h5py.Dataset) else _SEALS
    for name in sorted(attribute_names(thing)):
        if name not in excluded:
            try:
                found[name] = attribute(thing, name)
            except ValueError as err:
                found[name] = f"unreadable: {err}"
    return found


def _checked_json(root: h5py.Group, name: str, model: type[BaseModel]) -> dict[str, Any] | None:
    """Return the JSON of an attribute unchanged, after the model has validated it; None if it is absent or null."""
    text = attribute(root, name)
    if text is None:
        return None
    if not isinstance(text, str):
        raise ValueError(f"{name} is {shown(text)}, expected JSON")
    found = json_document(text, name)
    if found is None:
        return None
    try:
        model.model_validate(found)
    except ValidationError as err:
        first = err.errors(include_url=False, include_context=False)[0]
        place = ".".join(str(part) for part in (name, *first["loc"]))
        raise ValueError(f"{cut(place)}: {cut(field_fault(first, shown))}") from err
    return cast(dict[str, Any], found)


def _made(kind: type[_Description], found: Mapping[str, Any]) -> _Description:
    """Return a description made from its fields, each of its declared type."""
    types = _TYPES[kind]
    for name in found:
        if name not in types:
            raise ValueError(f"there is no {cut(name)} in a {kind.__name__}")
    values = {name: _typed(name, value, types[name]) for name, value in found.items()}
    try:
        return kind(**values)
    except TypeError as err:
        raise ValueError(str(err)) from err


def _typed(name: str, value: Any, wanted: Any) -> Any:
    if isinstance(wanted, UnionType):  # X | None: a value that is present is an X
        wanted = get_args(wanted)[0]
    if wanted is str and isinstance(value, str):
        return value
    number = wanted is not str and isinstance(value, int | float)
    if number and (math.isfinite(value) or (name in _MAY_BE_UNKNOWN and math.isnan(value))):
        if wanted is float:
            return float(value)
        if value == int(value) and 0 <= value <= LARGEST_WHOLE_NUMBER:
            return wanted(value)
    expected = {str: "text", float: "a finite number", int: "an integer", bool: "0 or 1"}[wanted]
    raise ValueError(f"{name} is {shown(value)}, expected {expected}")


def _part(found: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    return {name.removeprefix(prefix): value for name, value in found.items() if name.startswith(prefix)}
