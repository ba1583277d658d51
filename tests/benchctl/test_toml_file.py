"""TOML files whose fields are wrong in ways that nobody writes by hand."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.bench import SIMULATED, Bench, load_bench, template
from benchctl.model_file import read_model
from benchctl.recordings.column_map import parse_map
from benchctl.toml_file import line_of, parse_toml, read_text
from benchctl_instruments.errors import UsageError
from tests.slowness import slowness


def _refusal(text: str) -> str:
    begun = time.process_time()
    with pytest.raises(UsageError) as caught:
        parse_toml(text, Bench, "bench.toml")
    assert time.process_time() - begun < 1.0 * slowness()
    message = str(caught.value)
    assert message.startswith("bench.toml")
    assert len(message) < 1500
    return message


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("9" * 5000, "holds a number with too many digits"),
        ("0x" + "f" * 5000, "holds an integer of 20000 bits"),
        ("[" * 50 + "]" * 50, "time_factor: expected a number, got [[["),
        ('"' + "x" * 100_000 + '"', "time_factor: expected a number"),
        ("nan", "time_factor: expected"),
        ("1e999", "time_factor: expected a finite number"),
    ],
)
def test_a_value_is_shown_in_short_however_large_it_is(value: str, says: str) -> None:
    assert says in _refusal(f"time_factor = {value}\n" + template().replace("time_factor", "# time_factor"))


def test_a_field_that_is_not_there_is_named_in_short() -> None:
    assert "there is no such field" in _refusal("x" * 100_000 + " = 1\n" + template())


def test_a_fault_behind_brackets_and_blanks_in_a_text_is_found_in_time() -> None:
    text = 'operator = """\n[' + " " * 100_000 + '\n"""\n'
    assert "time_factor" in _refusal(text + "time_factor = -1.0\n" + template().replace("operator", "# operator"))


def test_a_long_unit_is_refused_in_short() -> None:
    text = f'[unit]\nserial = "a"\n[time]\nrate_hz = 1.0\n[channels.gyro_v]\ncolumn = 1\nunit = "{"x" * 100_000}"\n'
    with pytest.raises(UsageError, match=r"map\.toml, line 7: channels\.gyro_v\.unit: the unit 'xxx") as caught:
        parse_map(text, "map.toml")
    assert len(str(caught.value)) < 1500


@pytest.mark.parametrize("content", [b"\xff\xfe", b"a = 1\n" * (4 << 20)])
def test_a_file_that_is_no_text_or_far_too_long_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bench.toml").write_bytes(content)
    with pytest.raises(UsageError, match=r"bench .*bench\.toml: (expected UTF-8 text|is larger than 0\.15 MB)"):
        load_bench(str(tmp_path / "bench.toml"))


@pytest.mark.parametrize("end", ["\r\n", "\r", "\n"])
def test_lines_may_end_as_any_system_ends_them(tmp_path: Path, end: str) -> None:
    (tmp_path / "a.toml").write_bytes(f"a = 1{end}b = 2{end}".encode())
    assert read_text(tmp_path / "a.toml", "map file") == "a = 1\nb = 2\n"


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=60), st.integers(0, len(template())))
def test_whatever_is_written_into_a_bench_it_is_a_bench_or_refused(text: str, place: int) -> None:
    whole = template()
    try:
        parse_toml(whole[:place] + text + whole[place:], Bench, "bench.toml")
    except UsageError as err:
        assert str(err).startswith("bench.toml")  # noqa: PT017 - either is an answer


@pytest.mark.parametrize(
    "text",
    [
        "[parts.drive]\neffects = 1\n",
        "[parts]\ndrive = 1\n",
        "[effects]\nthermal_lag = 1\n",
        "[simulation]\nk_T = [[1]]\n",
    ],
)
def test_a_model_with_a_number_for_a_table_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "model.toml").write_text(text)
    with pytest.raises(UsageError, match=r"^model .*model\.toml: "):
        read_model(tmp_path / "model.toml")


def test_the_simulated_bench_is_a_bench() -> None:
    assert load_bench(SIMULATED).text == template()


FAULTS = """
[[faults]]                  # the first
on = "chamber"
kind = "silence"
[[faults]]
on = "chamber"
kind = "late"
after_s = 1.0
"""


@pytest.mark.parametrize(
    ("text", "says", "line"),
    [
        (f"{FAULTS}nth = 'x'\n", "faults.1.late.nth", "nth = 'x'"),
        (FAULTS.replace('"late"', '"never"'), "faults.1: expected kind to be one of", "[[faults]]\n"),
        (FAULTS.replace('"silence"', '"silence"\nnth = "y"'), "faults.0.silence.nth", 'nth = "y"'),
        (
            '[[interlocks]]\nquantity = "air_c"\nabove = 1.0\n[[interlocks]]\nquantity = "air_c"\nabove = "hot"\n',
            "interlocks.1.above",
            'above = "hot"',
        ),
        (
            '[[interlocks]]\nquantity = "air_c"\nabove = 1.0\n[[interlocks]]\nquantity = "gyro_c"\n',
            "interlocks.1: gyro_c: expected above, below or both",
            '[[interlocks]]\nquantity = "gyro_c"',
        ),
    ],
)
def test_a_fault_in_a_second_table_of_a_list_has_that_table_s_line(text: str, says: str, line: str) -> None:
    whole = template() + text
    message = _refusal(whole)
    number = whole[: whole.rindex(line)].count("\n") + 1
    assert message.startswith(f"bench.toml, line {number}: {says}")


@pytest.mark.parametrize(
    ("place", "line"),
    [
        (("a", 0, "b", 1, "c"), 7),
        (("a", 1, "b", 0, "c"), 12),
        (("a", 1, "b", 0), 11),
        (("a", 1, "x", "y"), 10),
        (("a", 1, "z"), 8),
        (("d",), 1),
        (("e", 1), 15),
        (("f", "g"), 17),
    ],
)
def test_lists_of_tables_in_lists_of_tables_are_counted_each_for_itself(
    place: tuple[str | int, ...], line: int
) -> None:
    text = """d = 1
[[a]]
[[a.b]]
c = 1

[[a.b]]
c = 2
[[a]]
[a.x]
y = 1
[[a.b]]
c = 3
[[e]]
f = 1
[[e]]
[f]   # a table
g = [
  [1, 2],
]
"""
    assert line_of(text, place) == line
