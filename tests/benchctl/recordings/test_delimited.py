"""Tables from strangers: delimiters, counts and columns that nobody meant; any bytes are numbers or a line of words."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchctl.recordings.importing import read_foreign
from benchctl.recordings.text_file import Layout, header_names, read_columns
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings.open_folder import HEADER, rows, write_open
from tests.slowness import slowness

MAP = """\
[unit]
serial = "G1"
{file}
[time]
{time}
[channels.gyro_v]
column = {column}
unit = "V"
{channel}
"""
TABLE = "t,out\n" + "".join(f"{0.1 * k:.1f},{k}\n" for k in range(10))


def refusal(
    folder: Path,
    *,
    table: str = TABLE,
    file: str = "",
    time_: str = 'column = "t"',
    column: str = '"out"',
    channel: str = "",
) -> str:
    source, mapping = folder / "log.csv", folder / "map.toml"
    source.write_text(table)
    mapping.write_text(MAP.format(file=file, time=time_, column=column, channel=channel))
    begun = time.process_time()
    with pytest.raises(UsageError) as caught:
        read_foreign(source, mapping)
    assert time.process_time() - begun < 1.0 * slowness()
    assert len(str(caught.value)) < 2000
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("delimiter", [r"\n", r"\r"])
def test_an_end_of_line_is_no_delimiter(tmp_path: Path, delimiter: str) -> None:
    assert "an end of line cannot be the delimiter" in refusal(tmp_path, file=f'[file]\ndelimiter = "{delimiter}"')


@pytest.mark.parametrize(
    "file",
    ["[file]\nheader_line = 99999999999999999999", "[file]\nfirst_line = 0x" + "f" * 60, "[file]\nheader_line = -1"],
)
def test_lines_that_no_file_has_are_refused(tmp_path: Path, file: str) -> None:
    refusal(tmp_path, file=file)


def test_a_column_that_no_line_can_hold_is_refused(tmp_path: Path) -> None:
    assert "line 7: channels.gyro_v.column" in refusal(tmp_path, column="9223372036854775808")
    assert "expected at least 1000000 cells, got 2 cells" in refusal(tmp_path, column="1000000")


def test_a_header_of_a_hundred_thousand_names_is_searched_in_time(tmp_path: Path) -> None:
    names = ",".join(f"a{k}" for k in range(100_000))
    message = refusal(tmp_path, table=f"t,{names}\n" + "0," * 100_000 + "0\n")
    assert "the column 'out' of the map is missing among 't', 'a0', 'a1'" in message
    assert message.endswith("and 99981 more")


def test_a_name_that_is_there_twice_is_named_and_cut(tmp_path: Path) -> None:
    assert "is there twice" in refusal(tmp_path, table=f"{'x' * 5000},{'x' * 5000},t,out\n1,2,3,4\n")


@pytest.mark.parametrize("cell", ["1_000", "0x10", "１", "1\x00", "nan", "1e999", "--1", '"1"', "\x0b"])
def test_what_is_no_number_is_named_by_line_and_column(tmp_path: Path, cell: str) -> None:
    table = TABLE.replace("0.3,3", f"0.3,{cell}")
    assert "log.csv, line 5, column out: expected a" in refusal(tmp_path, table=table)


def test_values_that_overflow_their_unit_are_named(tmp_path: Path) -> None:
    assert "line 3, column out: 1.0 becomes inf; correct unit, scale and offset" in refusal(
        tmp_path,
        channel="scale = 1e308\noffset = 1e308",
        table=TABLE.replace(",1\n", ",1.0\n").replace(",0\n", ",-1.0\n"),
    )


@pytest.mark.parametrize(
    ("time_", "says"),
    [
        ("rate_hz = 5e-324", "expected a rate of at least 1e-09 Hz"),
        ("rate_hz = 1e300", "expected a number of at most 1000000000000"),
        ("rate_hz = inf", "expected a finite number"),
    ],
)
def test_rates_without_an_ordinary_period_are_refused(tmp_path: Path, time_: str, says: str) -> None:
    assert says in refusal(tmp_path, time_=time_)


@pytest.mark.parametrize(
    ("stamps", "policy", "says"),
    [
        ((0, 1e300, 2e300), "refuse", "is further than 1e+12 s from its zero"),
        ((0, 1e-320, 2e-320), "refuse", "rows follow each other after 1e-320 s"),
        ((0, 1e-320, 2e-320), "repair", "from row to row"),
        ((0, 1e-9, 2e-9, 9e11), "repair", "from row to row"),
        ((-1.7e308, 0, 1.7e308), "repair", "is further than"),
        ((-1.7e308, 0, 1.7e308), "keep", "is further than"),
    ],
)
def test_stamps_that_are_no_clock_are_refused(
    tmp_path: Path, stamps: tuple[float, ...], policy: str, says: str
) -> None:
    table = "t,out\n" + "".join(f"{stamp!r},1\n" for stamp in stamps)
    assert says in refusal(tmp_path, table=table, time_=f'column = "t"\nstamps = "{policy}"')


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(st.binary(max_size=80) | st.text("0123456789.,;-+e \n\t\x0b\x0c\x1c\x85naif_", max_size=80).map(str.encode))
def test_any_bytes_are_finite_numbers_or_refused_with_their_place(tmp_path: Path, text: bytes) -> None:
    try:
        found = read_columns(
            tmp_path / "log.csv",
            text.replace(b"\r", b"\n") + b"\n",
            Layout(header_line=0, first_line=1),
            {"a": 0, "b": 1},
        )
    except UsageError as err:
        assert str(err).startswith(f"{tmp_path / 'log.csv'}")  # noqa: PT017 - either is an answer
        return
    assert found["a"].size == found["b"].size > 0
    assert all(np.isfinite(column).all() for column in found.values())


@given(st.binary(max_size=60))
def test_any_header_has_names_or_is_refused(text: bytes) -> None:
    try:
        names = header_names(Path("log.csv"), text + b"\n1\n", Layout())
    except UsageError as err:
        assert "is there twice" in str(err)  # noqa: PT017 - either is an answer
        return
    assert len(names) == text.split(b"\n")[0].count(b",") + 1


def test_an_open_recording_with_a_column_too_many_lists_names_in_short(tmp_path: Path) -> None:
    header = HEADER.replace("gyro_v", "x" * 100_000)
    with pytest.raises(UsageError, match="the column gyro_v is missing among") as caught:
        read_foreign(write_open(tmp_path / "bench", header=header, body=rows()))
    assert len(str(caught.value)) < 1000
