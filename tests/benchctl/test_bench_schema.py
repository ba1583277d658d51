"""The schema of bench.toml and its reader refuse the same."""

import copy
import json
import math
import tomllib
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import jsonschema_rs
import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchctl.bench import Bench, bench_of_text, load_bench, template
from benchctl.bench_schema import as_text, bench_schema, limits_schema
from benchctl.metrology.limit_file import limits_of_text, limits_template
from benchctl_instruments.catalog import models
from benchctl_instruments.errors import UsageError
from tests.benchctl.doctor.benches import bench_at

SCHEMA = bench_schema()
VALIDATOR = jsonschema_rs.validator_for(SCHEMA, validate_formats=True)
LIMITS_VALIDATOR = jsonschema_rs.validator_for(limits_schema())

FULL = (
    template()
    + """
[rate_table.certificate]
number = "LNE 2026-123"
encoder_arcsec = 2.0
[chamber.certificate]
air_c = "0.3 °C"
[digitizer.certificate]
gain_ppm = 40.0
[chamber.options]
unit_id = 3
[gyro]
model = "kvh_dsp1760"
calibrated_until = 2027-01-31
[gyro.options]
axis = "z"
[simulation]
K0_v_per_dps = 0.05
U0_v = 0.012
T0_c = 20.0
k_T = [-1.315e-4, 2.066e-6]
noise_v_rms = 0.0006
output_limit_v = 11
[effects.thermal_lag]
tau_s = "5 min"
[released.incoming]
title = "Incoming inspection"
procedure = "acceptance"
[notify]
urls = ["mailto://user:password@example.org", "env:BENCH_CHAT"]
on = ["done", "fault"]
[[interlocks]]
quantity = "gyro_c"
above = 70.0
hysteresis = 2.0
for_s = "0.5 min"
action = "hold"
give_up_s = 3600.0
[[faults]]
on = "chamber"
kind = "silence"
every_s = 30.0
[[faults]]
on = "digitizer_stream"
kind = "stream_gap"
packets = 2
"""
).replace('model = "watlow_f4t"', 'model = "watlow_f4t"\ncalibrated_until = 2027-01-31')
DOCUMENT = tomllib.loads(FULL)

ONLY_THE_READER_KNOWS = (
    "must be below hottest_c",
    "lies outside limits.coldest_c",
    "must be longer than limits.silence_s",
    "must be before to_s",
    "nothing is left between",
    "is no regular expression",
    "non-hexadecimal",
    "there is no such effect",
    "on one line",
    "bare or with a unit",
    "expected a bare number or one in degC",
    "which would make every voltage one temperature",
)
"""Of two numbers the larger, the kind of a quantity, the text of a pattern, effects of another installation."""


def _as_json(value: Any) -> Any:
    """A document as editors hand it to a schema: dates are texts."""
    if isinstance(value, dict):
        return {key: _as_json(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_as_json(item) for item in value]
    return value.isoformat() if isinstance(value, date) else value


def _refused_by_schema(document: dict[str, Any]) -> str:
    return "; ".join(error.message for error in VALIDATOR.iter_errors(_as_json(document)))


def _refused_by_reader(document: dict[str, Any]) -> str:
    from benchctl.bench import _check_simulation

    try:
        bench = bench_of_text(tomli_w.dumps(document), "bench.toml")
        _check_simulation(bench.model_copy(update={"physics": {}}), "bench.toml")
    except UsageError as err:
        return str(err)
    return ""


def _tables(value: Any) -> Iterator[dict[str, Any]]:
    if isinstance(value, dict):
        yield value
        for item in value.values():
            yield from _tables(item)
    elif isinstance(value, list):
        for item in value:
            yield from _tables(item)


def _free(value: dict[str, Any]) -> Iterator[int]:
    """The tables in which anything may stand: options and physics."""
    for table in _tables(value):
        for name in ("options", "physics"):
            if name in table:
                yield id(table[name])


OTHER_VALUES = st.one_of(
    st.booleans(),
    st.integers(-1000, 10**6),
    st.floats(-1e3, 1e6, allow_nan=False).filter(lambda number: not number.is_integer()),
    st.sampled_from(["", "2 min", "two", "3", "rate_table", "hold", "kvh_dsp1760", "2027-01-31", "tcp://a:1"]),
    st.just([]),
    st.just([1.0, 2.5]),
    st.just(["a"]),
    st.just({}),
    st.just({"x": 1}),
)
NEW_KEYS = st.sampled_from(["colour", "rate", "Model", "above", "below", "serial", "on", "address", "k", "give_up_s"])


@st.composite
def changed(draw: st.DrawFn) -> dict[str, Any]:
    """The full document with one to three changes: a value of another kind or size, a key gone, a key too many."""
    document = copy.deepcopy(DOCUMENT)
    for _ in range(draw(st.integers(1, 3))):
        free = set(_free(document))
        table = draw(st.sampled_from([each for each in _tables(document) if id(each) not in free]))
        act = draw(st.sampled_from(["set", "remove", "add"]))
        if act == "add" or not table:
            table[draw(NEW_KEYS)] = copy.deepcopy(draw(OTHER_VALUES))
            continue
        key = draw(st.sampled_from(sorted(table)))
        if act == "remove":
            del table[key]
        elif isinstance(table[key], int | float) and draw(st.booleans()):
            table[key] = draw(st.sampled_from([0, -1, 1, 0.5, 10**6, -table[key], str(table[key])]))
        else:
            table[key] = copy.deepcopy(draw(OTHER_VALUES))
    return document


def _agree(document: dict[str, Any]) -> None:
    by_schema, by_reader = _refused_by_schema(document), _refused_by_reader(document)
    if by_schema:
        assert by_reader, f"the schema alone refuses: {by_schema}"
    elif by_reader:
        assert any(says in by_reader for says in ONLY_THE_READER_KNOWS), f"the reader alone refuses: {by_reader}"


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(document=changed())
def test_schema_and_reader_refuse_the_same(document: dict[str, Any]) -> None:
    _agree(document)


@pytest.mark.slow
@pytest.mark.timeout(300)
@settings(max_examples=1500, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(document=changed())
def test_schema_and_reader_refuse_the_same_of_thousands(document: dict[str, Any]) -> None:
    _agree(document)


@pytest.mark.parametrize(
    "text",
    [
        template(),
        FULL,
        FULL.replace('model = "watlow_f4t"', 'model = "acme_9000.toml"'),
        FULL.replace('model = "acutrol3000"', 'model = "a_table_of_another_package"'),
        FULL.replace("rate_dps = 300.0", 'rate_dps = "50 rpm"').replace("silence_s = 10.0", "silence_s = 10"),
    ],
    ids=["template", "full", "profile", "third party", "units"],
)
def test_what_the_reader_takes_the_schema_takes(text: str) -> None:
    document = tomllib.loads(text)
    assert (_refused_by_reader(document), _refused_by_schema(document)) == ("", "")


def test_the_bench_that_sim_writes_obeys_the_schema() -> None:
    real = bench_at({})
    document = tomllib.loads(template()) | {"simulated": False, "time_factor": 20.0}
    for role in ("rate_table", "chamber", "digitizer"):
        document[role]["address"] = real.entries[role].address
    assert (_refused_by_reader(document), _refused_by_schema(document)) == ("", "")


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [
        ("limits", "rate_dps", True),
        ("limits", "rate_dps", "fast"),
        ("limits", "rate_dps", 0),
        ("limits", "rate_dsp", 300.0),
        ("site", "latitude_deg", 91),
        ("digitizer", "adc_bits", 7),
        ("digitizer", "encoder_sign", 2),
        ("digitizer", "adc_bits", "16"),
        ("digitizer", "thermistor_c_per_v", 0),
        ("chamber", "calibrated_until", 20270131),
        ("chamber", "calibrated_until", "soon"),
        ("simulation", "k_T", [True]),
        ("simulation", "k_T", "2"),
        ("unit", "serial", ""),
        ("gyro", "frame_rate_hz", -1.0),
    ],
)
def test_a_wrong_value_is_refused_by_both(table: str, key: str, value: object) -> None:
    document = copy.deepcopy(DOCUMENT)
    document[table][key] = value
    assert _refused_by_schema(document)
    assert _refused_by_reader(document)


def test_what_one_table_asks_of_another_is_in_the_schema() -> None:
    document = tomllib.loads(template())
    document["simulated"] = False
    assert "address" in _refused_by_schema(document)
    assert _refused_by_reader(document)
    del document["simulated"]
    assert _refused_by_schema(document)
    document = tomllib.loads(template()) | {"faults": [{"on": "gyro", "kind": "frame_lost"}]}
    assert _refused_by_schema(document)
    assert "there is no [gyro]" in _refused_by_reader(document)


def test_a_manual_table_needs_no_address_and_has_none() -> None:
    document = tomllib.loads(template()) | {"simulated": False}
    for role in ("chamber", "digitizer"):
        document[role]["address"] = bench_at({}).entries[role].address
    document["rate_table"]["model"] = "manual"
    assert (_refused_by_reader(document), _refused_by_schema(document)) == ("", "")
    document["rate_table"]["address"] = "tcp://127.0.0.1:1"
    assert _refused_by_schema(document)
    assert "a manual table has no wire; leave it out" in _refused_by_reader(document)


def test_every_field_has_a_title_and_every_unit_is_said() -> None:
    tables = [("Bench", SCHEMA), *SCHEMA["$defs"].items()]
    fields = [
        (f"{name}.{field}", told) for name, table in tables for field, told in table.get("properties", {}).items()
    ]
    assert [name for name, told in fields if "title" not in told] == []
    limits = SCHEMA["$defs"]["Limits"]["properties"]
    assert "In deg/s" in limits["rate_dps"]["description"]
    assert limits["rate_dps"]["examples"] == [300.0]
    assert "In K/min" in limits["ramp_c_per_min"]["description"]


def test_the_models_of_this_installation_are_offered() -> None:
    for table, kind in (("ChamberEntry", "chamber"), ("RateTableEntry", "rate_table"), ("GyroEntry", "gyro")):
        offered, _ = SCHEMA["$defs"][table]["properties"]["model"]["anyOf"]
        assert tuple(offered["enum"]) == models(kind)  # type: ignore[arg-type]


def test_the_schema_is_json_of_a_dialect_that_editors_know() -> None:
    written = json.loads(as_text(SCHEMA), parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert written["$schema"] == "http://json-schema.org/draft-07/schema#"
    jsonschema_rs.meta.validate(written)
    jsonschema_rs.meta.validate(json.loads(as_text(limits_schema())))


@pytest.mark.parametrize(
    ("old", "new", "fine"),
    [
        ("", "", True),
        ("[limits.delay]", "[limits.dealy]", False),
        ('unit = "V/(deg/s)"\n', "", True),
        ("guard = 1.0", "guard = -1", False),
        ("guard = 1.0", "gard = 1.0", False),
        ("rest_s = 600.0", 'rest_s = "10 min"', True),
        ("rest_s = 600.0", "rest_s = true", False),
    ],
)
def test_the_schema_of_limits_refuses_what_their_reader_refuses(old: str, new: str, fine: bool) -> None:
    text = limits_template().replace(old, new) if old else limits_template()
    assert LIMITS_VALIDATOR.is_valid(tomllib.loads(text)) is fine
    try:
        limits_of_text(text, Path("limits.toml"))
        taken = True
    except UsageError:
        taken = False
    assert taken is fine


def test_the_full_document_is_what_its_reader_makes_of_it() -> None:
    bench = bench_of_text(FULL, "bench.toml")
    assert isinstance(bench, Bench)
    assert bench.effects == {"thermal_lag": {"tau_s": 300.0}}
    assert bench.chamber.certificate is not None
    assert load_bench("simulated").simulated
    assert math.isclose(getattr(bench.chamber.certificate, "air_c", math.nan), 0.3)
