"""Create effects from tables of parameters in a model file or a bench.toml."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, fields

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect
from benchctl_instruments.physics.effects.numbered import identifier_in
from benchctl_instruments.physics.effects.registry import effect, effects

LATE = (
    "sensor_bandwidth",
    "saturation",
    "two_rails",
    "mains_pickup",
    "adc_nonlinearity",
    "adc_coarse",
    "outliers",
    "dropouts",
)
"""Effects that act after the others of their stage, in this order: amplifier, cable, converter, transmission."""


def make_effects(
    tables: Mapping[str, Mapping[str, float]],
    circumstances: Mapping[str, float] | None = None,
    *,
    where: str = "effects",
) -> tuple[PhysicalEffect, ...]:
    """Return effects from their parameters, by identifier, in the order in which those of one stage act.

    If a kind allows several effects, further ones are named `identifier_2`, `identifier_3` and so on. A table may also
    state circumstances of its effect; these override the common `circumstances`.

    Raises
    ------
    UsageError
        If an effect or field is unknown, missing, not a finite number or out of bounds; named as `[where.effect]`.
    """
    order = {identifier: place for place, identifier in enumerate(LATE)}
    made = [_made(name, table, circumstances or {}, where) for name, table in tables.items()]
    return tuple(sorted(made, key=lambda one: order.get(one.identifier, -1)))


def _made(name: str, table: Mapping[str, float], circumstances: Mapping[str, float], where: str) -> PhysicalEffect:
    try:
        kind = effect(identifier_in(name, effects()))
    except UsageError as err:
        raise UsageError(f"[{where}.{name}] {err}") from err
    place = f"[{where}.{name}]"
    if not isinstance(table, Mapping):
        raise UsageError(f"{place} expected a table of its parameters, got {table!r}")
    items = fields(kind)  # type: ignore[arg-type]  # effects are dataclasses
    known = [item.name for item in items]
    for field, value in table.items():
        if field not in known:
            raise UsageError(f"{place} {field}: no such field; there are {', '.join(known)}")
        _check(f"{place} {field}", value, kind.parameters.get(field))
    for item in items:
        if item.default is MISSING and item.name not in table:
            raise UsageError(f"{place} {item.name}: this field is needed and is not there")
    return kind.make(table, circumstances)


def _check(place: str, value: object, parameter: Parameter | None) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        raise UsageError(f"{place}: expected a number, got {value!r}")
    if parameter is None:
        if not math.isfinite(value):
            raise UsageError(f"{place}: expected a finite number, got {value!r}")
        return
    if value != parameter.zero and not parameter.low <= value <= parameter.high:
        raise UsageError(f"{place}: expected {parameter.low:g} to {parameter.high:g} ({parameter.unit}), got {value:g}")
    if parameter.role == "choice" and value != round(value):
        raise UsageError(f"{place}: expected an integer, got {value:g}")
