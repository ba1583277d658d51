"""The JSON schema of bench.toml, and of limits.toml: what an editor knows of a field while it is written.

Made from the models that read the files, so that both refuse the same: keys that do not exist, values of another kind
or beyond their bounds, what is missing. What only the reader knows: which of two numbers is the larger (coldest_c and
hottest_c), whether a text is a quantity of the right kind ("2 kg") and within bounds, whether a profile is there.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator
from typing import Any, get_args

from benchctl.bench import Bench
from benchctl.metrology.limit_file import LimitFile
from benchctl.metrology.names import UNITS
from benchctl.quantities import unit_stated
from benchctl_instruments.catalog import Kind, models
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect
from benchctl_instruments.physics.effects.registry import effects
from benchctl_instruments.simulated.faults.bench import AnyFault

Schema = dict[str, Any]

DIALECT = "http://json-schema.org/draft-07/schema#"
"""The one that editors of TOML know."""

BENCH_SCHEMA, LIMITS_SCHEMA = "bench.schema.json", "limits.schema.json"
"""The files' names, next to bench.toml and limits.toml."""

_NUMBER = r"(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*([^\d\s.+-].*)?$"
_KINDS: dict[str, Kind] = {
    "RateTableEntry": "rate_table",
    "ChamberEntry": "chamber",
    "DigitizerEntry": "digitizer",
    "GyroEntry": "gyro",
}


_IN_THE_UNIT_OF_ANOTHER = {"Interlock.above", "Interlock.below", "Interlock.hysteresis"}
"""Fields in the unit of the quantity in the same table."""


def directive(schema_name: str) -> str:
    """Return the line that names the schema for Taplo, Even Better TOML and others; first in the file."""
    return f"#:schema {schema_name}\n"


def bench_schema() -> Schema:
    """The schema of bench.toml; models and effects are those of this installation, and others stay allowed."""
    schema = _tidy(Bench.model_json_schema(), FIELD_WORDS)
    for name, kind in _KINDS.items():
        schema["$defs"][name]["properties"]["model"]["anyOf"] = [
            {"enum": list(models(kind)), "description": "A model that this installation has."},
            {"type": "string", "description": "A model of another package, or a chamber's profile (….toml)."},
        ]
    for fault in get_args(get_args(AnyFault)[0]):
        described = schema["$defs"][fault.__name__]
        described["required"] = ["on", "kind"]
        described["properties"]["on"]["enum"] = list(fault.places)
    schema["properties"]["effects"] |= _effects()
    schema["allOf"] = _rules_of_a_bench()
    schema["$defs"]["Interlock"]["allOf"] = _rules_of_an_interlock()
    schema["$defs"]["DigitizerEntry"]["properties"]["thermistor_c_per_v"]["not"] = {"const": 0}
    return {"$schema": DIALECT, **schema, "title": "A bench of benchctl"}


def limits_schema() -> Schema:
    """The schema of limits.toml."""
    schema = _tidy(LimitFile.model_json_schema(), {})
    entry = schema["properties"]["limits"].pop("additionalProperties")
    schema["properties"]["limits"] |= {
        "additionalProperties": False,
        "properties": {name: {**entry, "description": f"Measured in {unit}."} for name, unit in UNITS.items()},
    }
    return {"$schema": DIALECT, **schema, "title": "The limits of an acceptance"}


def as_text(schema: Schema) -> str:
    """A schema as its file holds it."""
    return json.dumps(schema, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _tidy(schema: Schema, words: dict[str, tuple[str, str, Any]]) -> Schema:
    """Pydantic's schema with words, units and quantities, and without what TOML has not (null) or JSON (infinity)."""
    for name, table in [(schema["title"], schema), *schema["$defs"].items()]:
        table.pop("title", None)
        for field, described in table.get("properties", {}).items():
            table["properties"][field] = _field(name, field, described, words)
    return schema


def _field(table: str, field: str, described: Schema, words: dict[str, tuple[str, str, Any]]) -> Schema:
    described.pop("title", None)
    described.get("items", {}).pop("discriminator", None)  # of OpenAPI, not of JSON schema
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
    title, description, example = words.get(f"{table}.{field}") or words.get(field) or ("", "", None)
    if title:
        described["title"] = title
    if text := " ".join(part for part in (description, _in_words(unit)) if part):
        described["description"] = text
    if example is not None:
        described["examples"] = [example]
    return described


def _quantity(number: Schema) -> Schema:
    """A number, or a text of a number and a unit."""
    lowest = max(number.get("minimum", -math.inf), number.get("exclusiveMinimum", -math.inf))
    sign = r"[+]?" if lowest >= 0 else r"[+−-]?"
    return {"anyOf": [number, {"type": "string", "pattern": rf"^\s*{sign}{_NUMBER}"}]}


def _in_words(unit: str) -> str:
    usual = unit.removesuffix(" or K")
    return f'In {usual}; or a text with a unit, as "1.5 {usual}".' if unit else ""


def _is_infinite(value: object) -> bool:
    return isinstance(value, float) and math.isinf(value)


def _effects() -> Schema:
    """The tables of `[effects]`: those of known effects in full; of kinds of which there may be several, NAME_2 too."""
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
        zero = parameter.zero  # which is always allowed
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
    """What one table asks of another."""
    real = {"properties": {"simulated": {"const": False}}}
    placed = {"required": ["address"]}
    return [
        {
            "if": real,
            "then": {
                "properties": {
                    **dict.fromkeys(("rate_table", "chamber", "digitizer", "gyro"), placed),
                    "effects": {"maxProperties": 0},
                    "faults": {"maxItems": 0},
                }
            },
        },
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


def undescribed(schema: Schema) -> Iterator[str]:
    """The fields that no words are known of, as TABLE.FIELD."""
    for name, table in [("Bench", schema), *schema["$defs"].items()]:
        for field, described in table.get("properties", {}).items():
            if "title" not in described:
                yield f"{name}.{field}"


Words = tuple[str, str, Any]
"""Title, description, and an example; None: none is needed."""

FIELD_WORDS: dict[str, Words] = {
    "Bench.name": ("Name", "What reports and recordings call this bench.", "bench 2, room 114"),
    "Bench.operator": ("Operator", "Who runs the bench; it goes into every recording.", "A. Ivanova"),
    "Bench.simulated": (
        "Simulated",
        "true: benchctl starts simulated instruments of these models and runs on their clock. false: the instruments "
        "are at their addresses.",
        True,
    ),
    "Bench.time_factor": ("Time factor", "Bench seconds a second of the wall; other than 1 with `benchctl sim`.", 1.0),
    "Bench.unit": ("Unit under test", "The gyro that is tested.", None),
    "Bench.limits": ("Limits", "What no step may exceed, and no measured value may pass.", None),
    "Bench.safe": ("Safe state", "Where the bench goes whatever ends a run.", None),
    "Bench.interlocks": ("Interlocks", "Limits of your own on what is measured, and what happens beyond.", None),
    "Bench.site": ("Site", "Location of the bench, for the Earth's rate.", None),
    "Bench.rate_table": ("Rate table", "The rate table, its driver, address and certificate.", None),
    "Bench.chamber": ("Chamber", "The climate chamber, its driver, address and certificate.", None),
    "Bench.digitizer": ("Digitizer", "What samples encoder and gyro, and what its terminals mean.", None),
    "Bench.gyro": ("Digital gyro", "A gyro that sends frames, where there is one.", None),
    "Bench.simulation": ("Believed model", "The model that the lab believes in; diagnosis begins with it.", None),
    "Bench.physics": ("Physics", "What the simulated bench obeys; every figure has a default.", {"seed": 1}),
    "Bench.effects": ("Effects", "Physics that the model leaves out, by name, for simulated benches only.", None),
    "Bench.faults": ("Faults", "What goes wrong on simulated links and in simulated instruments.", None),
    "UnitUnderTest.serial": ("Serial number", "That of the unit; its history goes by it.", "SN-0017"),
    "UnitUnderTest.model": ("Model", "The unit's model; units of one model are compared.", "VG910Q"),
    "range_dps": ("Rated range", "The unit's rated range.", 175.0),
    "Limits.rate_dps": ("Highest rate", "No step turns faster; a measured rate beyond it stops the run.", 300.0),
    "Limits.acceleration_dps2": ("Highest acceleration", "No step accelerates faster.", 1500.0),
    "Limits.coldest_c": ("Coldest air", "No set point lies below; below hottest_c.", -55.0),
    "Limits.hottest_c": ("Hottest air", "No set point lies above; above coldest_c.", 85.0),
    "Limits.ramp_c_per_min": ("Ramp", "How fast the chamber's air follows; durations are reckoned with it.", 2.0),
    "Limits.silence_s": ("Silence", "An instrument that is silent for so long stops the run.", 10.0),
    "Limits.motion_error_dps": (
        "Motion",
        "How far the rate by the encoder may be off the demand while a step is recorded; beyond it the step is "
        "repeated once, then the run stops. The encoder's resolution is added.",
        0.5,
    ),
    "Limits.motion_error_percent": (
        "Motion, relative",
        "The same as a share of the rate that is demanded; the larger of the two counts.",
        2.0,
    ),
    "Safe.chamber_c": ("Safe set point", "Between limits.coldest_c and limits.hottest_c.", 23.0),
    "Safe.hang_s": (
        "Hang",
        "A run on real instruments that hangs for so long is ended by its guard; wall time, longer than silence_s.",
        60.0,
    ),
    "Interlock.quantity": ("Quantity", "What is watched; setpoint_error_c is air less set point.", "gyro_c"),
    "Interlock.above": ("Above", "Beyond this, in the quantity's unit; above, below or both.", 70.0),
    "Interlock.below": ("Below", "Beneath this, in the quantity's unit; above, below or both.", -60.0),
    "Interlock.hysteresis": ("Hysteresis", "It is over once the value is back inside by so much.", 2.0),
    "Interlock.for_s": ("For", "It counts once it has lasted so long (bench time); 0: at once.", 30.0),
    "Interlock.action": (
        "Action",
        "stop ends the run; hold ends the step, then waits with the table at rest.",
        "hold",
    ),
    "Interlock.give_up_s": (
        "Give up",
        "A hold that lasts longer ends the run; for hold, and only for it.",
        3600.0,
    ),
    "Site.latitude_deg": ("Latitude", "Positive in the north.", 58.5),
    "Site.latitude_uncertainty_deg": ("Uncertainty of the latitude", "Expanded, k = 2.", 0.05),
    "Simulation.K0_v_per_dps": ("Scale factor", "K0 of U = U0 + K0·k(T)·k(ω)·ω.", 0.05),
    "Simulation.U0_v": ("Bias", "U0, the output at rest.", 0.012),
    "Simulation.T0_c": ("Reference temperature", "T0, at which k(T) is 1.", 20.0),
    "Simulation.k_T": ("Temperature coefficients", "a1, a2, … of k(T); empty: no such term.", [-1.315e-4, 2.066e-6]),
    "Simulation.k_omega": ("Rate coefficients", "b2, b4, … of k(ω); empty: no such term.", [-3.375e-6, 3.417e-12]),
    "Simulation.noise_v_rms": ("Noise", "The noise of one sample.", 0.0006),
    "Simulation.output_limit_v": ("Output limit", "Where the gyro's output clips.", 11.0),
    "model": ("Model", "The driver; those that this installation has are offered, others may be added.", None),
    "ChamberEntry.model": (
        "Model",
        "The driver; those of this installation are offered. Or the path of a profile that ends in .toml, next to this "
        "file.",
        "own_profile.toml",
    ),
    "address": (
        "Address",
        "tcp://HOST:PORT, serial:///dev/ttyUSB0?baud=19200, serial://COM3?baud=9600, or socket://HOST:PORT for a "
        "serial line behind a TCP box.",
        "tcp://192.168.1.60:502",
    ),
    "stream_address": ("Stream", "Where the stream is; port 702 of the same host where it is not given.", None),
    "serial": ("Serial number", "As its certificate names it.", "CH-1234"),
    "calibrated_until": ("Calibrated until", "The last day on which its certificate holds.", "2027-01-31"),
    "certificate": ("Certificate", "What it states: expanded uncertainties; the rest is assumed.", None),
    "options": ("Options", "Further keywords of the driver; its docstring names them.", {"unit_id": 3}),
    "DigitizerEntry.sample_rate_hz": ("Sample rate", "Scans a second.", 500.0),
    "DigitizerEntry.adc_bits": ("Bits", "Of the converter.", 16),
    "DigitizerEntry.adc_range_v": ("Range", "± so much.", 10.0),
    "DigitizerEntry.encoder_counts_per_rev": ("Encoder", "Counts a revolution, all edges counted.", 360000),
    "DigitizerEntry.encoder_sign": ("Sign", "-1 where the count falls while the table turns counter-clockwise.", 1),
    "DigitizerEntry.encoder_accuracy_arcsec": ("Encoder's accuracy", "Of an angle; 0: not stated.", 20.0),
    "DigitizerEntry.thermistor_c_per_v": ("Thermistor", "Degrees a volt of its amplifier; not 0.", 20.0),
    "DigitizerEntry.thermistor_c_at_0v": ("Thermistor at 0 V", "In °C, where its amplifier gives 0 V.", 0.0),
    "GyroEntry.frame_rate_hz": ("Frame rate", "Frames a second.", 1000.0),
    "GyroEntry.sign": ("Sign", "-1 where its rate falls while the table turns counter-clockwise.", 1),
    "number": ("Number", "That of the certificate, on one line.", "LNE 2026-123"),
    "k": ("Coverage factor", "Of all figures of this certificate.", 2.0),
    "encoder_arcsec": ("Encoder", "The largest error of an angle.", 2.0),
    "tilt_deg": ("Tilt", "Of the axis from the vertical.", 0.02),
    "mounting_deg": ("Mounting", "Of a unit's input axis from the table's axis, by the fixture.", 0.1),
    "air_c": ("Air", "Of the temperature of the air.", 0.3),
    "gain_ppm": ("Gain", "Of its volts.", 40.0),
    "offset_v": ("Offset", "Of its volts.", 2e-5),
    "clock_ppm": ("Clock", "Of its clock.", 10.0),
    "thermometer_c": ("Thermometer", "Of the unit's thermistor with its amplifier.", 0.1),
    "on": ("On", "The link, or the instrument at its end.", "chamber"),
    "kind": ("Kind", "What goes wrong.", "silence"),
    "pattern": ("Pattern", "A regular expression that the request must hold.", "^03 0b 04"),
    "from_s": ("From", "Bench time from which it may happen.", 60.0),
    "to_s": ("To", "Bench time up to which it may happen.", 120.0),
    "nth": ("Nth", "It happens to this one only, counted from 1.", 3),
    "every": ("Every", "It happens to every so many.", 50),
    "every_s": ("Every", "It happens once in so long (bench time).", 30.0),
    "times": ("Times", "It happens so often at most.", 5),
    "behind_s": ("Behind", "So long before the answer to the repeated request (wall time).", 0.03),
    "ClockDrift.ppm": ("Drift", "How much too fast the crystal is.", 20.0),
    "code": ("Code", "Modbus' exception code.", 4),
    "counts": ("Counts", "By how much the count is off.", 50000),
    "delay_s": ("Delay", "So much later (wall time).", 0.3),
    "for_s": ("For", "How long it lasts.", 0.5),
    "gap_s": ("Gap", "Between the two pieces (wall time).", 0.02),
    "junk": ("Junk", "The bytes, in hex.", "ff 00 5a"),
    "packets": ("Packets", "How many are lost.", 1),
    "reads": ("Reads", "°C of the air, or volts at a terminal.", 1000.0),
    "reads_dps": ("Reads", "What the tachometer reads.", 10000.0),
    "scans": ("Scans", "How many are skipped.", 50),
    "short_c": ("Short", "How far before the set point it comes to a halt.", 5.0),
    "terminal": ("Terminal", "Of the digitizer.", "thermistor"),
}
