"""Chamber profiles: every mistake is one line that names the file and the field."""

from __future__ import annotations

import os
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchctl_instruments.chambers.profile import (
    MOST_BYTES,
    Profile,
    changed,
    parse_profile,
    profile_of,
    profile_text,
    shipped_profile,
)
from benchctl_instruments.chambers.profiled import ProfiledChamber
from benchctl_instruments.errors import UsageError
from benchctl_instruments.simulated.profiled import SimulatedProfiled
from tests.instruments.chamber_machine import FakeChamber, InstantClock
from tests.instruments.chambers.lab_controllers import ACME, BRAND
from tests.slowness import slowness

SHIPPED = ("binder_mb1", "binder_mb2", "csz_ezt430i", "eurotherm_2400", "eurotherm_3500")
SMALLEST = """
name = "N"
source = "S"
kept_limits_c = [0.0, 50.0]
air = { address = 1, kind = "signed" }
setpoint = { address = 2, kind = "signed" }
switch = { by = "nothing" }
"""


def with_changes(text: str, **changes: Any) -> str:
    """A profile's text with fields put in, or with None taken out."""
    document = tomllib.loads(text) | changes
    return tomli_w.dumps({key: value for key, value in document.items() if value is not None})


def test_the_smallest_profile_has_the_defaults_of_the_standard() -> None:
    profile = parse_profile(SMALLEST, "lab.toml")
    assert (profile.transport.functions, profile.transport.unit_id, profile.transport.pause_s) == ((3, 6, 16), 1, 0.0)
    assert (profile.decimals, profile.alarms, profile.manufacturer) == (0, (), "")


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_profile_is_sound_and_says_where_its_numbers_come_from(name: str) -> None:
    assert len(shipped_profile(name).source) > 20


@pytest.mark.parametrize("name", SHIPPED)
def test_a_profile_without_changes_stays_what_it_is(name: str) -> None:
    profile = shipped_profile(name)
    assert changed(profile, {}, "changes") == profile


def test_a_switch_of_another_kind_replaces_the_whole_table_and_fields_only_themselves() -> None:
    brand = parse_profile(BRAND, "lab.toml")
    assert changed(brand, {"switch": {"by": "nothing"}}, "changes").switch.by == "nothing"
    moved = changed(brand, {"switch": {"address": 77}, "air": {"decimals": 2}}, "changes")
    assert (moved.switch.model_dump()["address"], moved.switch.model_dump()["on"]) == (77, 0x0800)
    assert (moved.air.address, moved.air.decimals, moved.air.valid_c) == (10, 2, (-100.0, 300.0))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"air": None}, "air: this field is needed and is not there"),
        ({"source": "  "}, "source: expected some words in one line, got '  '"),
        ({"colour": 3}, "colour: there is no such field"),
        ({"air": {"address": "35", "kind": "signed"}}, "air.address: expected an integer, got '35'"),
        ({"air": {"address": 65536, "kind": "signed"}}, "air.address: expected a number of at most 65535"),
        ({"air": {"address": True, "kind": "signed"}}, "air.address: expected an integer, got True"),
        ({"air": {"address": 35, "kind": "bcd"}}, "air.kind: expected 'u16', 'signed' or 'f32', got 'bcd'"),
        ({"air": {"address": 65535, "kind": "f32"}}, "air: registers 65535 to 65536, and there are none above 65535"),
        ({"air": {"address": 35, "kind": "signed", "decimals": 4}}, "air.decimals: expected a number of at most"),
        (
            {"air": {"address": 1, "kind": "signed", "invalid": {"high": "over range"}}},
            "air.invalid: expected numbers in front of the words, got 'high'",
        ),
        (
            {"air": {"address": 1, "kind": "signed", "valid_c": [5.0, 1.0]}},
            "air.valid_c: the first (5) must be below the second (1)",
        ),
        ({"transport": {"functions": [4, 16]}}, "transport.functions.0: expected 3, 6 or 16, got 4"),
        ({"transport": {"functions": [3]}}, "transport.functions: needs 3, to read, and 6 or 16, to write"),
        (
            {"transport": {"functions": [3, 6]}, "setpoint": {"address": 2, "kind": "f32"}},
            "setpoint: an f32 is written with function 16, which is not in transport.functions",
        ),
        ({"transport": {"unit_id": 0}}, "transport.unit_id: expected a number of at least 1"),
        ({"transport": {"pause_s": -1.0}}, "transport.pause_s: expected a number of at least 0"),
        ({"transport": {"pause_s": float("inf")}}, "transport.pause_s: expected a finite number, got inf"),
        ({"transport": {"restricted": [[9, 5]]}}, "transport.restricted.0: the first register (9) lies above the last"),
        ({"transport": {"restricted": [[2, 5]]}}, "setpoint: register 2 lies in the restricted range 2 to 5"),
        (
            {"transport": {"runs": [{"first": 1, "count": 9}], "restricted": [[7, 8]]}},
            "transport.runs.0: register 7 lies in the restricted range 7 to 8",
        ),
        (
            {"transport": {"runs": [{"first": 1, "count": 9}], "most_registers": 4}},
            "transport.runs.0: 9 registers, and transport.most_registers is 4",
        ),
        (
            {"transport": {"most_registers": 1}, "power": {"address": 5, "kind": "f32"}},
            "power: an f32 takes two registers, and transport.most_registers is 1",
        ),
        ({"low_limit": {"address": 3, "kind": "signed"}}, "low_limit: a controller has both limits or none"),
        (
            {"kept_limits_c": [-40.0, 50.0], "setpoint": {"address": 2, "kind": "u16"}},
            "kept_limits_c: -40 does not fit",
        ),
        ({"kept_limits_c": None}, "kept_limits_c: needed where there are no low_limit and high_limit, and only there"),
        (
            {"power": {"address": 5, "kind": "signed"}, "cooling": {"address": 6, "kind": "signed"}},
            "power: it is one number with its sign, or heating and cooling, not both",
        ),
        (
            {"setpoint": {"address": 2, "kind": "signed", "readable": False}},
            "setpoint.readable: what cannot be read back needs setpoint.taken",
        ),
        (
            {"setpoint": {"address": 2, "kind": "signed", "readable": False, "wears": True}},
            "setpoint.wears: only a change is written, so the register must be readable",
        ),
        (
            {"switch": {"by": "magic"}},
            "switch: expected by to be one of 'nothing', 'register', 'bit', 'key', got 'magic'",
        ),
        (
            {"switch": {"by": "register", "address": 3, "on": 2, "off": 6, "mask": 3}},
            "switch.register: on (2) and off (6) are not distinguishable",
        ),
        (
            {"switch": {"by": "key", "address": 3, "press": 1, "shown": 4, "on": 1, "off": 1}},
            "switch.key: on (1) and off (1) are not distinguishable",
        ),
        (
            {"switch": {"by": "bit", "address": 3, "bit": 16}},
            "switch.bit.bit: expected a number of at most 15",
        ),
        (
            {
                "switch": {
                    "by": "register",
                    "address": 3,
                    "on": 1,
                    "off": 0,
                    "after_off": [{"address": 4, "kind": "u16", "value": -1.0}],
                }
            },
            "switch.after_off.0: -1 does not fit into a register of kind u16",
        ),
        (
            {"alarms": [{"name": "a", "address": 3, "bits": {"16": "x"}}]},
            "alarms.0.bits: expected bits 0 to 15 in front of the words, got '16'",
        ),
        (
            {"alarms": [{"name": "a", "address": 3, "words": {"-1": "x"}}]},
            "alarms.0.words: expected integers 0 to 65535 in front of the words, got '-1'",
        ),
        (
            {"alarms": [{"name": "a", "address": 3, "bits": {"1": "x"}, "words": {"2": "y"}}]},
            "alarms.0.bits: a status word has bits, a code has fine, words and otherwise, not both",
        ),
        (
            {"air": {"address": 1, "kind": "f32"}},
            "setpoint: register 2 (signed) is also air's (f32 from 1 on)",
        ),
        (
            {"modes": [{"name": "a", "address": 2}]},
            "modes.0.address: register 2 (code) is also setpoint's (signed from 2 on)",
        ),
        (
            {"alarms": [{"name": "two\nlines", "address": 3}]},
            "alarms.0.name: expected some words in one line, got 'two",
        ),
        (
            {"checks": [{"name": "a", "address": 3, "expected": [], "advice": "b"}]},
            "checks.0.expected: expected at least 1 item, got []",
        ),
        ({"air": 3, "switch": 4}, "(and 1 more)"),
    ],
)
def test_a_mistake_is_one_line_that_names_the_file_and_the_field(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_profile(with_changes(SMALLEST, **changes), "lab.toml")
    message = str(caught.value)
    assert message.startswith("lab.toml, ")
    assert says in message
    assert message.isprintable()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("name = ", "not TOML: invalid value"),
        ("a = " + "9" * 5000, "not TOML: "),
        ("a = " + "[" * 5000, "not TOML: "),
        (SMALLEST + "decimals = 0x" + "f" * 5000, "got a number that is far too long"),
        ("", "name: this field is needed and is not there"),
        ("a = 1\n" + "a." * 5000 + "a = 1", ", line 2: 5000 dots, expected at most 200 in a line"),
        ("#" * (MOST_BYTES + 1), "expected at most 131072"),
    ],
)
def test_a_text_that_is_no_profile_is_named_in_time(text: str, says: str) -> None:
    begun = time.process_time()
    with pytest.raises(UsageError, match=r"lab\.toml") as caught:
        parse_profile(text, "lab.toml")
    assert says in str(caught.value)
    assert time.process_time() - begun < 1.0 * slowness()


def test_a_profile_of_a_thousand_alarms_is_read_in_time() -> None:
    alarms = "".join(f'[[alarms]]\nname = "a{k}"\naddress = {k + 9}\nbits = {{ 1 = "x" }}\n' for k in range(1000))
    begun = time.process_time()
    assert len(parse_profile(SMALLEST + alarms, "lab.toml").alarms) == 1000
    assert time.process_time() - begun < 2.0 * slowness()


@pytest.mark.parametrize(
    ("content", "says"),
    [(b"\xff\xfe", "cannot be read as UTF-8 text"), (b"#" * (MOST_BYTES + 1), "is larger than 128 KiB")],
)
def test_a_file_that_is_no_profile_is_named(tmp_path: Path, content: bytes, says: str) -> None:
    file = tmp_path / "lab.toml"
    file.write_bytes(content)
    with pytest.raises(UsageError, match=r"lab\.toml") as caught:
        profile_text(file)
    assert says in str(caught.value)


@pytest.mark.parametrize("name", ["not_there.toml", ".", "nul\0.toml"])
def test_a_file_that_cannot_be_read_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match=r"chamber profile .*: cannot be read") as caught:
        profile_text(Path(f"{tmp_path}/{name}"))
    assert str(caught.value).isprintable()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
def test_a_pipe_is_no_profile_and_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "lab.toml")
    with pytest.raises(UsageError, match=r"lab\.toml: cannot be read: it is no file"):
        profile_text(tmp_path / "lab.toml")


def usable(profile: Profile) -> Profile:
    """A profile of which a driver and a simulated controller can be made; that fails otherwise."""
    ProfiledChamber("tcp://localhost:1", profile=profile, clock=InstantClock())
    SimulatedProfiled(FakeChamber(), profile=profile)
    return profile


def said(act: Callable[[], Profile]) -> str:
    """What a `UsageError` says; every other exception goes through."""
    try:
        return f"lab.toml is {act().name}"
    except UsageError as err:
        return str(err)


@given(st.text(max_size=200))
def test_no_text_makes_anything_but_a_usage_error(text: str) -> None:
    message = said(lambda: parse_profile(text, "lab.toml"))
    assert message.startswith("lab.toml")
    assert message.isprintable()


LEAVES = (
    st.booleans()
    | st.integers(-(2**40), 2**40)
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from(["nothing", "register", "bit", "key", "signed", "u16", "f32", 0, 1, 3, 6, 16, 65535])
    | st.dates()
)
KEYS = st.text(max_size=4) | st.sampled_from([*Profile.model_fields, "address", "kind", "by", "on", "off", "0", "-1"])
VALUES = st.recursive(LEAVES, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=4))


@given(data=st.data(), base=st.sampled_from([ACME, BRAND, SMALLEST]))
@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None)
def test_no_value_anywhere_in_a_profile_makes_anything_but_a_usage_error(data: st.DataObject, base: str) -> None:
    document = tomllib.loads(base)
    inside = document
    key = data.draw(st.sampled_from(sorted(document)) | KEYS)
    while isinstance(inside.get(key), dict) and data.draw(st.booleans()):
        inside = inside[key]
        key = data.draw(st.sampled_from(sorted(inside)) | KEYS if inside else KEYS)
    inside[key] = data.draw(VALUES)
    message = said(lambda: usable(profile_of(document, "lab.toml")))
    assert message.startswith("lab.toml")
    assert message.isprintable()
