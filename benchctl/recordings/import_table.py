"""Reads the columns that a map asks for from delimited text."""

from __future__ import annotations

from pathlib import Path

from benchctl.limits import listed, shown
from benchctl.recordings.column_map import ColumnMap
from benchctl.recordings.delimited import Layout, header_names, read_columns
from benchctl.recordings.raw_columns import RawColumns, Wanted, wanted_columns
from benchctl.recordings.text_file import read_bytes
from benchctl_instruments.errors import UsageError


def read_table(path: Path, mapping: ColumnMap) -> RawColumns:
    """The mapped columns of a text file (gzip or not).

    Raises
    ------
    UsageError
        A column that is not there, or a cell that is no finite number; names file, line and column.
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
    """The number, from 0, of a column."""
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
