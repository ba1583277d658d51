"""Import a foreign recording into a benchctl file: detect its format, read it, write it completely or not at all.

Columns come from delimited text, JSON (rows, or columns by name), SQLite and MATLAB files, steps from open recordings.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchctl.limits import cut, listed, require_file, require_memory, shown
from benchctl.recordings.column_map import ColumnMap, RawColumns, Wanted, raw_columns, read_map, wanted_columns
from benchctl.recordings.import_mat import read_mat
from benchctl.recordings.import_open import (
    OPEN_DESCRIPTION,
    read_description,
    read_open_recording,
    samples_of,
)
from benchctl.recordings.mapped import build_recording
from benchctl.recordings.model import Meta, Step
from benchctl.recordings.static_points import build_points, map_by_header
from benchctl.recordings.text_file import Layout, header_names, read_bytes, read_columns, sources_json
from benchctl.recordings.writer import write_recording
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError, reason


def read_table(path: Path, mapping: ColumnMap) -> RawColumns:
    """Return the mapped columns of a text file (gzip or not).

    Raises
    ------
    UsageError
        A column does not exist, or a cell is not a finite number; names file, line and column.
    """
    if mapping.file.first_row_variable is not None:
        raise UsageError(f"{path}: file.first_row_variable is for MAT files; of a text say file.first_line")
    text = read_bytes(path)
    layout = Layout(
        delimiter=mapping.file.delimiter,
        decimal=mapping.file.decimal,
        header_line=mapping.file.header_line,
        first_line=mapping.file.first_line or mapping.file.header_line + 1,
    )
    names = header_names(path, text, layout)
    wanted = wanted_columns(mapping)
    numbers = {str(column): _number(path, column, names, layout) for column in wanted.values()}
    columns = read_columns(path, text, layout, numbers)
    values = {channel: columns[str(column)] for channel, column in wanted.items()}
    return RawColumns(path=path, values=values, wanted=wanted, first_row=layout.first_line, row_word="line")


def _number(path: Path, wanted: Wanted, names: tuple[str, ...], layout: Layout) -> int:
    """Return the number, from 0, of a column."""
    if wanted.index is not None:
        raise UsageError(f"{path}: index belongs to the matrices of MAT files; name the column {wanted.column} alone")
    if isinstance(wanted.column, int):
        return wanted.column - 1
    if wanted.column in names:
        return names.index(wanted.column)
    if not names:
        raise UsageError(f"{path}: has no header (file.header_line = 0), so that {wanted.column!r} must be a number")
    raise UsageError(
        f"{path}, line {layout.header_line}: the column {shown(wanted.column)} of the map is missing among "
        f"{listed([repr(name) for name in names])}"
    )


_MEMORY_PER_BYTE = 20
"""A number of five characters in JSON becomes an object of 24 bytes and more, in a list or a table of names."""


def read_json(path: Path, mapping: ColumnMap) -> RawColumns:
    """Return the mapped columns of a JSON file: `[{"t": 0.0, …}, …]`, `[[0.0, …], …]` or `{"t": [0.0, …], …}`.

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
    except (ValueError, RecursionError) as err:  # includes UnicodeDecodeError
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
    """Return the mapped columns of a table (`file.table`, or the only one) or of a SELECT (`file.query`), read-only.

    Raises
    ------
    UsageError
        Not an SQLite database, no such table or column, a query that SQLite refuses, or a value that is not a number.
    """
    require_file(path)
    try:
        # the file belongs to a lab: nothing is written, and no journal file is created
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
    """Return every selected column from `first_line` on; `column` returns one by its name and its place."""
    wanted = wanted_columns(mapping)
    values: dict[str, FloatArray] = {}
    for channel, one in wanted.items():
        name, place = _found(path, one, names)
        values[channel] = _numbers(path, name, column(name, place))
    return raw_columns(path, values, wanted, mapping.file.first_line or 1)


def _found(path: Path, wanted: Wanted, names: Sequence[str]) -> tuple[str, int]:
    """Return a column's name and its place, from 0."""
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
    """Return a column of numbers, shape (rows,); a boolean counts as 0 or 1."""
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


_READERS = {".mat": read_mat, ".json": read_json, **dict.fromkeys((".db", ".sqlite", ".sqlite3"), read_sqlite)}
_TEXTS = (".csv", ".txt", ".log", ".tsv", ".dat", ".asc")
_OURS = (".h5", ".hdf5")


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """The result of an import: the file, its number of steps and samples, and the treatment of the stamps in words."""

    output: Path
    meta: Meta
    steps: int
    samples: int
    treatment: str


def import_recording(source: Path, map_file: Path | None, output: Path) -> Imported:
    """Write a foreign recording as a benchctl file.

    Parameters
    ----------
    source
        An open recording's folder, delimited text (`.gz` or not), a MAT file, JSON or an SQLite database.
    map_file
        Which column is which (`map_examples`); not needed for an open recording, nor for a table of static points with
        benchctl's names.
    output
        The HDF5 file to write; it appears only when it is complete.

    Raises
    ------
    UsageError
        One line with the file and the place at fault.
    """
    meta, steps = read_foreign(source, map_file)
    write_recording(output, meta, steps)
    return Imported(
        output=output,
        meta=meta,
        steps=len(steps),
        samples=sum(step.info.samples for step in steps),
        treatment=meta.provenance.get("treatment", ""),
    )


def read_foreign(source: Path, map_file: Path | None = None) -> tuple[Meta, list[Step]]:
    """Read a foreign recording into memory; raises `UsageError` as `import_recording` does."""
    if not source.exists():
        raise UsageError(f"{source}: there is no such file or folder; correct the name")
    if map_file is None:
        return _read_unmapped(source)
    mapping, text = read_map(map_file)
    sources = [source]
    if source.is_dir():
        description = read_description(source)
        sources = [source / "recording.json", samples_of(source)]
        meta, steps = build_recording(read_table(sources[1], mapping), mapping, str(map_file), description)
    else:
        raw = _READERS.get(source.suffix.lower(), read_table)(source, mapping)
        build = build_points if mapping.points is not None else build_recording
        meta, steps = build(raw, mapping, str(map_file))
    return _with_sources(meta, sources, map=text), steps


def _read_unmapped(source: Path) -> tuple[Meta, list[Step]]:
    if source.is_dir():
        if not (source / OPEN_DESCRIPTION).is_file():
            raise UsageError(f"{source}: no open recording, expected a folder with recording.json")
        return read_open_recording(source)
    kind = _kind(source)
    if kind in _OURS:
        raise UsageError(f"{source}: is an HDF5 file; every command takes those of benchctl as they are")
    if kind in _TEXTS and (mapping := map_by_header(source)) is not None:
        return _read_points(source, mapping)
    raise UsageError(
        f"{source}: which column is which is not known; name a map file (--map), `benchctl import --help` shows one for"
        " text, MAT, JSON and SQLite (an open recording's folder, or a CSV with the columns rate_dps and gyro_v_mean,"
        " needs none)"
    )


def _read_points(source: Path, mapping: ColumnMap) -> tuple[Meta, list[Step]]:
    meta, steps = build_points(read_table(source, mapping), mapping, str(source))
    return _with_sources(meta, [source]), steps


def _with_sources(meta: Meta, sources: Sequence[Path], **further: str) -> Meta:
    return replace(meta, provenance={**meta.provenance, "sources": sources_json(sources), **further})


def _kind(source: Path) -> str:
    """Return the extension that identifies a file, without `.gz`."""
    return Path(source.name.removesuffix(".gz")).suffix.lower()
