"""Recordings that labs keep as JSON, as an SQLite database, or as columns between blanks."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchctl.recordings.importing import read_foreign
from benchctl_instruments.errors import UsageError

ROWS = 50
TIME = [0.01 * k for k in range(ROWS)]
ANGLE = [0.5 * k for k in range(ROWS)]
RATE = [50.0 + k % 3 for k in range(ROWS)]

MAP = """
[unit]
serial = "SN-1"
[file]
{file}
[time]
column = {time}
[channels.encoder_deg]
column = {angle}
unit = "deg"
[channels.gyro_v]
column = {rate}
unit = "deg/s"
"""


def imported(tmp_path: Path, name: str, *, file: str = "", names: tuple[str, str, str] = ("'t'", "'a'", "'w'")) -> None:
    mapping = tmp_path / "map.toml"
    mapping.write_text(MAP.format(file=file, time=names[0], angle=names[1], rate=names[2]))
    meta, (step,) = read_foreign(tmp_path / name, mapping)
    assert step.channels["time_s"] == pytest.approx(TIME)
    assert step.channels["encoder_deg"] == pytest.approx(np.mod(ANGLE, 360.0))
    assert step.channels["gyro_v"].tolist() == RATE
    assert meta.extra["gyro_output_unit"] == "deg/s"
    assert name in meta.provenance["sources"]


@pytest.mark.parametrize(
    ("document", "file", "names"),
    [
        ([{"t": t, "a": a, "w": w} for t, a, w in zip(TIME, ANGLE, RATE, strict=True)], "", ("'t'", "'a'", "'w'")),
        ({"t": TIME, "a": ANGLE, "w": RATE}, "", ("'t'", "'a'", "'w'")),
        ([list(row) for row in zip(TIME, ANGLE, RATE, strict=True)], "", ("1", "2", "3")),
        ({"run": {"data": {"t": TIME, "a": ANGLE, "w": RATE}}}, "table = 'run.data'", ("'t'", "'a'", "'w'")),
    ],
)
def test_json_is_read_as_rows_or_as_columns(
    tmp_path: Path, document: Any, file: str, names: tuple[str, str, str]
) -> None:
    (tmp_path / "log.json").write_text(json.dumps(document))
    imported(tmp_path, "log.json", file=file, names=names)


@pytest.fixture
def database(tmp_path: Path) -> Path:
    path = tmp_path / "bench.db"
    with closing(sqlite3.connect(path)) as made, made:
        made.execute("CREATE TABLE samples (t REAL, a REAL, w REAL, run INTEGER)")
        rows = [(t, a, w, run) for run in (1, 2) for t, a, w in zip(TIME, ANGLE, RATE, strict=True)]
        made.executemany("INSERT INTO samples VALUES (?, ?, ?, ?)", rows)
        made.execute("CREATE VIEW 'first run' AS SELECT * FROM samples WHERE run = 1")
    return path


@pytest.mark.parametrize("file", ["table = 'first run'", "query = 'SELECT t, a, w FROM samples WHERE run = 2'"])
def test_a_database_is_read_by_table_or_query_and_not_changed(tmp_path: Path, database: Path, file: str) -> None:
    before = database.read_bytes()
    imported(tmp_path, "bench.db", file=file)
    assert database.read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bench.db", "map.toml"]


@pytest.mark.parametrize(
    ("file", "says"),
    [
        ("", r"bench\.db: has the tables 'first run', 'samples'; name one by file\.table"),
        ("table = 'runs'", r"the table 'runs' of the map is missing among 'first run', 'samples'"),
        ("query = 'SELECT t FROM gone'", "cannot be read as an SQLite database: no such table: gone"),
        ("query = 'SELECT t, a, run FROM samples'", "the column 'w' of the map is missing among 't', 'a', 'run'"),
        ("query = \"SELECT t, a, 'fast' AS w FROM samples\"", "row 1, column w: expected a number, got 'fast'"),
        ("query = 'DELETE FROM samples'", "attempt to write a readonly database"),
    ],
)
def test_a_database_that_does_not_hold_what_the_map_names_is_refused(
    tmp_path: Path, database: Path, file: str, says: str
) -> None:
    with pytest.raises(UsageError, match=says):
        imported(tmp_path, database.name, file=file)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{", "is no JSON"),
        ("[" * 100_000, "is no JSON"),
        ("3", "expected rows or columns of numbers, got int"),
        ('{"t": [0, 1], "a": [0, 1], "w": [1]}', "different numbers of rows: t 2, a 2, w 1"),
        ('[{"t": 0, "a": 1, "w": 2}, {"t": 1, "a": 2}]', "row 2, column w: expected a number, got None"),
        ('{"t": [0, NaN], "a": [0, 1], "w": [1, 1]}', "row 2, column t: expected a finite number, got nan"),
    ],
)
def test_json_that_holds_no_such_columns_is_refused_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "log.json").write_text(text)
    with pytest.raises(UsageError, match=says) as caught:
        imported(tmp_path, "log.json")
    assert "\n" not in str(caught.value)


def test_columns_between_blanks_are_read_with_leading_ones(tmp_path: Path) -> None:
    lines = [f"  {t:.6f} \t{a:9.4f}   {w:g} \n" for t, a, w in zip(TIME, ANGLE, RATE, strict=True)]
    (tmp_path / "log.dat").write_text("".join(lines))
    imported(tmp_path, "log.dat", file="delimiter = ' '\nheader_line = 0", names=("1", "2", "3"))
    (tmp_path / "named.dat").write_text("".join([" t   a\tw\n", *lines]))
    imported(tmp_path, "named.dat", file="delimiter = ' '")


def test_a_row_that_is_too_short_is_named_between_blanks_too(tmp_path: Path) -> None:
    (tmp_path / "log.dat").write_text(" 0.0 1.0 2.0\n 0.01  1.5\n")
    with pytest.raises(UsageError, match=r"line 2: expected at least 3 cells, got 2"):
        imported(tmp_path, "log.dat", file="delimiter = ' '\nheader_line = 0", names=("1", "2", "3"))
