"""JSON schemas of bench.toml and limits.toml, by which editors explain, complete and check their fields.

The schemas are generated from the models that read the files, so that both refuse the same: unknown keys, values of
another type or out of bounds, missing fields. Only the reader checks relations between numbers (coldest_c and
hottest_c), whether a text is a quantity of the right kind ("2 kg") and within bounds, and whether a profile exists.
"""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from benchctl.bench import Bench
from benchctl.metrology.limit_file import LimitFile
from benchctl.metrology.names import UNITS
from benchctl.units import unit_stated
from benchctl_instruments.catalog import MANUAL, Kind, models
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect
from benchctl_instruments.physics.effects.registry import effects
from benchctl_instruments.simulated.faults.bench import AnyFault
from benchctl_instruments.simulated.faults.schedule import FaultTable

Schema = dict[str, Any]

DIALECT = "http://json-schema.org/draft-07/schema#"
"""The dialect of JSON Schema that TOML editors support."""

BENCH_SCHEMA, LIMITS_SCHEMA = "bench.schema.json", "limits.schema.json"
"""Names of the schema files, next to bench.toml and limits.toml."""

_NUMBER = r"(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*([^\d\s.+-].*)?$"
_KINDS: dict[str, Kind] = {
    "RateTableEntry": "rate_table",
    "ChamberEntry": "chamber",
    "DigitizerEntry": "digitizer",
    "GyroEntry": "gyro",
}


_IN_THE_UNIT_OF_ANOTHER = {"Interlock.above", "Interlock.below", "Interlock.hysteresis"}
"""Fields in the unit of the `quantity` of the same table."""


def directive(schema_name: str) -> str:
    """Return the first line of a file, which names the schema for Taplo, Even Better TOML and others."""
    return f"#:schema {schema_name}\n"


def bench_schema() -> Schema:
    """Return the schema of bench.toml; it lists the models and effects of this installation and allows others."""
    schema = _tidy(Bench)
    kind_of_fault = _tidy(FaultTable)["properties"]["kind"]
    for name, kind in _KINDS.items():
        schema["$defs"][name]["properties"]["model"]["anyOf"] = [
            {"enum": list(models(kind)), "description": "A model that this installation has."},
            {"type": "string", "description": "A model of another package, or a chamber's profile (….toml)."},
        ]
    for fault in get_args(get_args(AnyFault)[0]):
        described = schema["$defs"][fault.__name__]
        described["required"] = ["on", "kind"]
        described["properties"]["on"]["enum"] = list(fault.places)
        described["properties"]["kind"] |= {name: kind_of_fault[name] for name in ("title", "description", "examples")}
    schema["properties"]["effects"] |= _effects()
    schema["allOf"] = _rules_of_a_bench()
    schema["$defs"]["Interlock"]["allOf"] = _rules_of_an_interlock()
    schema["$defs"]["DigitizerEntry"]["properties"]["thermistor_c_per_v"]["not"] = {"const": 0}
    return {"$schema": DIALECT, **schema, "title": "A bench of benchctl"}


def limits_schema() -> Schema:
    """Return the schema of limits.toml."""
    schema = _tidy(LimitFile)
    entry = schema["properties"]["limits"].pop("additionalProperties")
    schema["properties"]["limits"] |= {
        "additionalProperties": False,
        "properties": {name: {**entry, "description": f"Measured in {unit}."} for name, unit in UNITS.items()},
    }
    return {"$schema": DIALECT, **schema, "title": "The limits of an acceptance"}


def as_text(schema: Schema) -> str:
    """Return the text of a schema file."""
    return json.dumps(schema, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


class _WithoutTitles(GenerateJsonSchema):
    """pydantic's schema with no other titles than those that are given."""

    def field_title_should_be_set(self, schema: object) -> bool:
        """Return whether pydantic makes a title from the name."""
        return False


def _tidy(model: type[BaseModel]) -> Schema:
    """Add texts, units and quantities to pydantic's schema; remove null (not in TOML) and infinity (not in JSON)."""
    schema = model.model_json_schema(schema_generator=_WithoutTitles)
    for name, table in [(model.__name__, schema), *schema.get("$defs", {}).items()]:
        table.pop("title", None)
        for field, described in table.get("properties", {}).items():
            table["properties"][field] = _field(name, field, described)
    return schema


def _field(table: str, field: str, described: Schema) -> Schema:
    title, explained = described.pop("title", field.replace("_", " ").capitalize()), described.pop("description", "")
    examples = described.pop("examples", [])
    described.get("items", {}).pop("discriminator", None)  # a keyword of OpenAPI, not of JSON schema
    default = described.pop("default", None)
    choices = [choice for choice in described.pop("anyOf", []) if choice != {"type": "null"}]
    if len(choices) == 1:
        described |= choices[0]
    elif choices:
        described["anyOf"] = choices
    unit = unit_stated(field)
    if described.get("type") == "number" and (unit or f"{table}.{field}" in _IN_THE_UNIT_OF_ANOTHER):
        described = _quantity(described)
    if default is not None and not _is_infinite(default) and not isinstance(default, dict):
        described["default"] = default
    if "$ref" in described:  # draft 7 ignores the keys next to a reference
        described["allOf"] = [{"$ref": described.pop("$ref")}]
    if explained:
        described["title"] = title
        if not examples and isinstance(default, str | int | float):
            examples = [default]
    if text := " ".join(part for part in (explained, _in_words(unit)) if part):
        described["description"] = text
    if examples:
        described["examples"] = examples
    return described


def _quantity(number: Schema) -> Schema:
    """Return the schema of a number, or a text of a number and a unit."""
    lowest = max(number.get("minimum", -math.inf), number.get("exclusiveMinimum", -math.inf))
    sign = r"[+]?" if lowest >= 0 else r"[+−-]?"
    return {"anyOf": [number, {"type": "string", "pattern": rf"^\s*{sign}{_NUMBER}"}]}


def _in_words(unit: str) -> str:
    usual = unit.removesuffix(" or K")
    return f'In {usual}; or a text with a unit, as "1.5 {usual}".' if unit else ""


def _is_infinite(value: object) -> bool:
    return isinstance(value, float) and math.isinf(value)


def _effects() -> Schema:
    """Return the schema of `[effects]`: known effects in full, also as NAME_2, NAME_3, … if several are allowed."""
    patterns = {
        f"^{name}{'(_([2-9]|[1-9][0-9]+))?' if kind.several else ''}$": _effect(kind)
        for name, kind in effects().items()
    }
    return {"patternProperties": patterns, "additionalProperties": {"type": "object"}}


def _effect(kind: type[PhysicalEffect]) -> Schema:
    items = dataclasses.fields(kind)  # type: ignore[arg-type]  # effects are dataclasses
    needed = [item.name for item in items if item.default is dataclasses.MISSING]
    properties = {item.name: _parameter(item.name, kind.parameters.get(item.name)) for item in items}
    return {"type": "object", "properties": properties, "required": needed, "additionalProperties": False}


def _parameter(name: str, parameter: Parameter | None) -> Schema:
    number: Schema = {"type": "number"}
    if parameter is not None:
        bounds: Schema = {"minimum": parameter.low, "maximum": parameter.high}
        zero = parameter.zero  # always allowed
        if zero is not None and math.isfinite(zero) and not parameter.low <= zero <= parameter.high:
            number["anyOf"] = [{"const": zero}, bounds]
        elif zero is not None and math.isinf(zero):
            number["minimum" if zero > 0.0 else "maximum"] = parameter.low if zero > 0.0 else parameter.high
        else:
            number |= bounds
    described = _quantity(number) if unit_stated(name) else number
    if parameter is not None:
        described["description"] = f"{parameter.meaning[:1].upper()}{parameter.meaning[1:]}. In {parameter.unit}."
    return described


def _rules_of_a_bench() -> list[Schema]:
    """Return the rules between tables."""
    real = {"properties": {"simulated": {"const": False}}}
    placed: Schema = {"required": ["address"]}
    manual: Schema = {"properties": {"model": {"const": MANUAL}}}
    return [
        {
            "if": real,
            "then": {
                "properties": {
                    "rate_table": {"anyOf": [manual, placed]},
                    **dict.fromkeys(("chamber", "digitizer", "gyro"), placed),
                    "effects": {"maxProperties": 0},
                    "faults": {"maxItems": 0},
                }
            },
        },
        {"properties": {"rate_table": {"anyOf": [{"not": manual}, {"not": placed}]}}},
        {
            "if": {"not": {"required": ["gyro"]}},
            "then": {"properties": {"faults": {"items": {"not": {"properties": {"on": {"const": "gyro"}}}}}}},
        },
    ]


def _rules_of_an_interlock() -> list[Schema]:
    holds = {"properties": {"action": {"const": "hold"}}, "required": ["action"]}
    return [
        {"anyOf": [{"required": ["above"]}, {"required": ["below"]}]},
        {
            "if": holds,
            "then": {"required": ["give_up_s"], "properties": {"quantity": {"not": {"const": "encoder_dps"}}}},
            "else": {"not": {"required": ["give_up_s"]}},
        },
    ]
