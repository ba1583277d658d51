"""Reads the variables that a map asks for from a MATLAB file, versions 5 to 7."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat, whosmat
from scipy.io.matlab import MatReadError

from benchctl.recordings.column_map import ColumnMap
from benchctl.recordings.model import FloatArray
from benchctl.recordings.raw_columns import RawColumns, Wanted, wanted_columns
from instruments.errors import UsageError


def read_mat(path: Path, mapping: ColumnMap) -> RawColumns:
    """The mapped variables of a MAT file, from the first row that the map says.

    Raises
    ------
    UsageError
        Not such a file, a variable that is not there or is no column of numbers, columns of different lengths.
    """
    wanted = wanted_columns(mapping)
    first_variable = mapping.file.first_row_variable
    names = {str(column.column) for column in wanted.values()} | ({first_variable} if first_variable else set())
    variables = _load(path, names)
    first = mapping.file.first_line or 1
    if first_variable is not None:
        first = _first_row(path, first_variable, variables[first_variable])
    whole = {channel: _column(path, column, variables[str(column.column)]) for channel, column in wanted.items()}
    lengths = {str(wanted[channel]): values.size for channel, values in whole.items()}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise UsageError(f"{path}: the columns have different numbers of rows: {told}")
    if first > min(lengths.values()):
        raise UsageError(f"{path}: has {min(lengths.values())} rows, none from row {first}, where the map begins")
    values = {channel: column[first - 1 :] for channel, column in whole.items()}
    raw = RawColumns(path=path, values=values, wanted=wanted, first_row=first, row_word="row")
    raw.require_finite()
    return raw


def _load(path: Path, names: set[str]) -> dict[str, Any]:
    try:
        there = [name for name, _, _ in whosmat(path)]
        if missing := sorted(names - set(there)):
            raise UsageError(f"{path}: the variable {missing[0]!r} of the map is missing among {', '.join(there)}")
        loaded: dict[str, Any] = loadmat(path, variable_names=sorted(names))
    except NotImplementedError as err:
        raise UsageError(f"{path}: a MAT file of version 7.3; save it with MATLAB's option -v7") from err
    except OSError as err:
        raise UsageError(f"{path}: cannot be read: {err.strerror or err}") from err
    except (MatReadError, ValueError, TypeError, EOFError, IndexError) as err:
        raise UsageError(f"{path}: not a MAT file of version 5 to 7, or cut short: {err}") from err
    return loaded


def _first_row(path: Path, name: str, value: Any) -> int:
    found = np.asarray(value)
    if found.size != 1 or found.dtype.kind not in "iuf" or int(found.ravel()[0]) < 1:
        raise UsageError(f"{path}: {name} should hold one row number from 1, it holds {found.dtype} {found.shape}")
    return int(found.ravel()[0])


def _column(path: Path, wanted: Wanted, value: Any) -> FloatArray:
    """One column of numbers, shape (rows,)."""
    matrix = np.asarray(value)
    if matrix.dtype.kind not in "iuf" or matrix.ndim != 2:
        raise UsageError(f"{path}: {wanted.column} is not a column of numbers but {matrix.dtype} {matrix.shape}")
    if wanted.index is not None:
        if wanted.index > matrix.shape[1]:
            raise UsageError(f"{path}: {wanted.column} has {matrix.shape[1]} columns, the map asks for {wanted.index}")
        return np.ascontiguousarray(matrix[:, wanted.index - 1], dtype=np.float64)
    if 1 not in matrix.shape:
        raise UsageError(
            f"{path}: {wanted.column} is a matrix of {matrix.shape[0]} by {matrix.shape[1]}; "
            "say index, the column in it"
        )
    return np.ascontiguousarray(matrix.ravel(), dtype=np.float64)
