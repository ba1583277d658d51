"""JSON and TOML from strangers: one line for whatever is wrong, in less than a second."""

from __future__ import annotations

import json
import time
import tomllib
from typing import Any

import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.documents import json_document, toml_document
from benchctl.toml_file import line_of
from benchctl_instruments.errors import UsageError
from tests.slowness import slowness

_LEAVES = st.none() | st.booleans() | st.integers(-(2**64), 2**64) | st.floats(allow_nan=False) | st.text()
_DOCUMENTS = st.recursive(_LEAVES, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=20)


@settings(max_examples=50, deadline=None)
@given(_DOCUMENTS)
def test_sound_json_comes_back_as_it_was(document: Any) -> None:
    assert json_document(json.dumps(document), "a.json") == document


@settings(max_examples=50, deadline=None)
@given(st.dictionaries(st.text(), st.integers(-(2**63), 2**63 - 1) | st.text() | st.lists(st.floats(allow_nan=False))))
def test_sound_toml_comes_back_as_it_was(document: dict[str, Any]) -> None:
    assert toml_document(tomli_w.dumps(document), "a.toml") == document


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[" * 100_000, "a.json: nested too deep, expected at most 64 levels"),
        ("[" * 65 + "]" * 65, "a.json: nested too deep, expected at most 64 levels"),
        ('{"a":' * 900 + "1" + "}" * 900, "a.json: nested too deep"),
        ("9" * 100_000, "a.json: holds a number with too many digits"),
        ("9" * 40, "a.json: holds an integer of 133 bits, expected at most 64"),
        ('{"a": -' + "9" * 40 + "}", "a.json: holds an integer of 133 bits"),
        ('{\n"a": open}', "a.json, line 2: not JSON"),
        ("", "a.json, line 1: not JSON"),
        (b'{"a": "\xe9"}', "a.json: expected UTF-8 text, byte 7 is not"),
        (b" " * (17 << 20), "a.json: 17825792 bytes, expected at most 16777216"),
    ],
)
def test_json_that_cannot_be_meant_is_refused(text: str | bytes, says: str) -> None:
    with pytest.raises(UsageError) as caught:
        json_document(text, "a.json")
    assert str(caught.value).startswith(says)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a = " + "[" * 5000, "a.toml: nested too deep"),
        ("a = " + "[" * 64 + "]" * 64, "a.toml: nested too deep"),
        ("a = " + "9" * 100_000, "a.toml: holds a number with too many digits"),
        ("a = 0x" + "f" * 100_000, "a.toml: holds an integer of 400000 bits"),
        ("\nb = 1\n" + "a." * 60_000 + "a = 1", "a.toml, line 3: a key of more than 64 parts"),
        ("x = {" + "a . " * 30_000 + "a = 1}", "a.toml, line 1: a key of more than 64 parts"),
        ("[" + '"a".' * 30_000 + "a]", "a.toml, line 1: a key of more than 64 parts"),
        ("a = 1\n" * 50_000, "a.toml: 300000 bytes, expected at most 150000"),
        ("a = ", "a.toml: not TOML: invalid value (at end of document)"),
    ],
)
def test_toml_that_cannot_be_meant_is_refused_at_once(text: str, says: str) -> None:
    begun = time.process_time()
    with pytest.raises(UsageError) as caught:
        toml_document(text, "a.toml")
    assert time.process_time() - begun < 1.0 * slowness()
    assert str(caught.value).startswith(says)


def test_a_list_of_many_numbers_is_no_long_key() -> None:
    text = "a = [" + ", ".join("1.5" for _ in range(1000)) + "]\nb = 'a.b.c'\n"
    assert toml_document(text, "a.toml") == tomllib.loads(text)


@pytest.mark.parametrize("line", ["[" + " " * 100_000, "[" * 100_000, " " * 100_000, "a" * 100_000, '"' * 100_000])
def test_the_line_of_a_field_is_found_in_time_whatever_stands_beside_it(line: str) -> None:
    begun = time.process_time()
    assert line_of(f'x = """\n{line}\n"""\n[a]\nb = 1\n', ("a", "b")) == 5
    assert time.process_time() - begun < 1.0 * slowness()
