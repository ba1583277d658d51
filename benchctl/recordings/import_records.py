"""Reads the columns that a map asks for from JSON (a list of rows, or columns by name) or from an SQLite database."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from benchctl.limits import cut, listed, require_file, require_memory, shown
from benchctl.recordings.column_map import ColumnMap
from benchctl.recordings.raw_columns import RawColumns, Wanted, wanted_columns
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError, reason

_MEMORY_PER_BYTE = 20
"""A number that JSON writes in five characters is an object of 24 bytes and more, in a list or a table of names."""


def read_json(path: Path, mapping: ColumnMap) -> RawColumns:
    """The mapped columns of a JSON file: `[{"t": 0.0, …}, …]`, `[[0.0, …], …]` or `{"t": [0.0, …], …}`.

    `file.table` names the place of that table in a larger document, keys joined by dots.

    Raises
    ------
    UsageError
        Not JSON, no table of numbers at that place, a column that is missing, or columns of different lengths.
    """
    require_file(path)
    try:
        require_memory(path, _MEMORY_PER_BYTE * path.stat().st_size, "its content")
        document = json.loads(path.read_bytes())
    except OSError as err:
        raise UsageError(f"{path}: cannot be read: {reason(err)}") from err
    except (ValueError, RecursionError) as err:  # UnicodeDecodeError among them
        raise UsageError(f"{path}: is no JSON: {cut(str(err))}") from err
    for key in mapping.file.table.split(".") if mapping.file.table else ():
        if not isinstance(document, dict) or key not in document:
            known = listed([repr(name) for name in document]) if isinstance(document, dict) else "no names there"
            raise UsageError(f"{path}: file.table: {shown(key)} is missing among {known}")
        document = document[key]
    if isinstance(document, dict):
        return _columns(path, mapping, tuple(document), lambda name, _: document[name])
    if isinstance(document, list) and document and all(isinstance(row, dict) for row in document):
        return _columns(path, mapping, tuple(document[0]), lambda name, _: [row.get(name) for row in document])
    if isinstance(document, list) and document and all(isinstance(row, list) for row in document):
        return _columns(
            path, mapping, (), lambda _, place: [row[place] if place < len(row) else None for row in document]
        )
    raise UsageError(
        f"{path}: expected rows or columns of numbers, got {type(document).__name__}; "
        "name the table in the document by file.table in the map"
    )


def read_sqlite(path: Path, mapping: ColumnMap) -> RawColumns:
    """The mapped columns of a table (`file.table`, or the only one) or of a SELECT (`file.query`), opened read-only.

    Raises
    ------
    UsageError
        No SQLite database, no such table or column, a query that SQLite refuses, or a value that is no number.
    """
    require_file(path)
    try:
        # the file is one that a lab keeps: nothing is written, and no journal is made beside it
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
            found = database.execute(mapping.file.query or _everything(_table(path, database, mapping)))
            names = tuple(column[0] for column in found.description or ())
            rows = found.fetchall()
    except (sqlite3.Error, sqlite3.Warning) as err:
        raise UsageError(f"{path}: cannot be read as an SQLite database: {cut(str(err))}") from err
    return _columns(path, mapping, names, lambda _, place: [row[place] for row in rows])


def _table(path: Path, database: sqlite3.Connection, mapping: ColumnMap) -> str:
    listing = database.execute("SELECT name FROM sqlite_master WHERE type IN ('table', 'view') ORDER BY name")
    tables = [str(name) for (name,) in listing]
    wanted = mapping.file.table
    if wanted in tables or (not wanted and len(tables) == 1):
        return wanted or tables[0]
    known = listed([repr(name) for name in tables])
    raise UsageError(
        f"{path}: the table {shown(wanted)} of the map is missing among {known}"
        if wanted
        else f"{path}: has the tables {known}; name one by file.table in the map, or rows by file.query"
    )


def _everything(table: str) -> str:
    quoted = table.replace('"', '""')
    return f'SELECT * FROM "{quoted}"'  # noqa: S608 - the table is one of the database's own


def _columns(path: Path, mapping: ColumnMap, names: Sequence[str], column: Callable[[str, int], Any]) -> RawColumns:
    """Every wanted column from `first_line` on, by its name and its place."""
    wanted = wanted_columns(mapping)
    first = mapping.file.first_line or 1
    values: dict[str, FloatArray] = {}
    for channel, one in wanted.items():
        name, place = _found(path, one, names)
        values[channel] = _numbers(path, name, column(name, place))[first - 1 :]
    lengths = {str(wanted[channel]): one.size for channel, one in values.items()}
    if len(set(lengths.values())) > 1:
        counted = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise UsageError(f"{path}: the columns have different numbers of rows: {counted}; map those of one length")
    if not all(lengths.values()):
        raise UsageError(f"{path}: has no rows from row {first}, where the map begins; correct file.first_line")
    raw = RawColumns(path=path, values=values, wanted=wanted, first_row=first, row_word="row")
    raw.require_finite()
    return raw


def _found(path: Path, wanted: Wanted, names: Sequence[str]) -> tuple[str, int]:
    """A column's name and its place, from 0."""
    if wanted.index is not None:
        raise UsageError(f"{path}: index belongs to the matrices of MAT files; name the column {wanted.column} alone")
    if isinstance(wanted.column, int):
        if names and wanted.column > len(names):
            raise UsageError(f"{path}: has {len(names)} columns, the map asks for number {wanted.column}; correct it")
        return (names[wanted.column - 1] if names else f"{wanted.column}"), wanted.column - 1
    if wanted.column not in names:
        known = listed([repr(name) for name in names]) if names else "columns without names: give its number"
        raise UsageError(f"{path}: the column {shown(wanted.column)} of the map is missing among {known}")
    return wanted.column, list(names).index(wanted.column)


def _numbers(path: Path, name: str, values: Any) -> FloatArray:
    """A column of numbers, shape (rows,); a boolean counts as 0 or 1."""
    if not isinstance(values, list):
        raise UsageError(f"{path}: {name} is no list of numbers; name another column")
    for row, value in enumerate(values, 1):
        if not isinstance(value, int | float):
            raise UsageError(f"{path}, row {row}, column {name}: expected a number, got {shown(value)}")
    try:
        return np.array(values, dtype=np.float64)
    except OverflowError as err:
        raise UsageError(
            f"{path}: {name} holds a number too large for a float64; correct it, or leave the column out"
        ) from err
