"""Reads the variables that a map asks for from a MATLAB file, versions 5 to 7."""

from __future__ import annotations

import warnings
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError, MatReadWarning, matfile_version

from benchctl.limits import cut, listed, require_file, require_memory
from benchctl.recordings.column_map import ColumnMap
from benchctl.recordings.mat_headers import variables_in
from benchctl.recordings.model import FloatArray
from benchctl.recordings.raw_columns import RawColumns, Wanted, wanted_columns
from instruments.errors import UsageError, reason

_MOST_ROWS = 1 << 53


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
        raise UsageError(f"{path}: the columns have different numbers of rows: {told}; map those of one length")
    if first > min(lengths.values()):
        raise UsageError(
            f"{path}: has {min(lengths.values())} rows, none from row {first}, where the map begins; correct first_line"
        )
    values = {channel: column[first - 1 :] for channel, column in whole.items()}
    raw = RawColumns(path=path, values=values, wanted=wanted, first_row=first, row_word="row")
    raw.require_finite()
    return raw


def _load(path: Path, names: set[str]) -> dict[str, Any]:
    require_file(path)
    try:
        with path.open("rb") as file:
            version, _ = matfile_version(file)  # type: ignore[arg-type]  # its stubs know no open files
            if version == 2:
                raise UsageError(f"{path}: a MAT file of version 7.3; save it with MATLAB's option -v7")
            if version != 1:
                raise UsageError(f"{path}: a MAT file of version 4; save it with MATLAB's option -v7")
            _check_variables(path, file, names)
            file.seek(0)
            with warnings.catch_warnings():
                warnings.simplefilter("error", MatReadWarning)
                loaded: dict[str, Any] = loadmat(  # its stubs know no open files
                    file,  # type: ignore[arg-type]
                    variable_names=sorted(names),
                )
    except OSError as err:
        raise UsageError(f"{path}: cannot be read: {reason(err)}") from err
    except (MatReadError, MatReadWarning, ValueError, TypeError, LookupError, EOFError, MemoryError, zlib.error) as err:
        raise UsageError(f"{path}: not a MAT file of version 5 to 7, or cut short: {cut(str(err))}") from err
    return loaded


def _check_variables(path: Path, file: BinaryIO, names: set[str]) -> None:
    """Raise `UsageError` where a wanted variable is not there, is no matrix of numbers, or more than memory holds.

    scipy is asked for these variables only after all headers were found to be sound.
    """
    there = list(variables_in(file))
    by_name = {variable.name: variable for variable in there}
    for name in sorted(names):
        if name not in by_name:
            raise UsageError(f"{path}: the variable {name!r} of the map is missing among {listed(list(by_name))}")
        if not by_name[name].numeric:
            raise UsageError(
                f"{path}: {name} is not a column of numbers but text, a cell, a structure or complex; name another"
            )
        if sum(variable.name == name for variable in there) > 1:
            raise UsageError(f"{path}: the variable {name!r} is there twice; save the file again")
    # scipy holds what it unpacked, the matrix, and it is made float64 here.
    require_memory(path, sum(3 * 8 * by_name[name].size for name in names), "what the map asks for")


def _first_row(path: Path, name: str, value: Any) -> int:
    found = np.asarray(value)
    if found.size != 1 or found.dtype.kind not in "iuf" or not 1 <= found.ravel()[0] <= _MOST_ROWS:
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
        return _as_float64(matrix[:, wanted.index - 1])
    if 1 not in matrix.shape:
        raise UsageError(
            f"{path}: {wanted.column} is a matrix of {matrix.shape[0]} by {matrix.shape[1]}; "
            "say index, the column in it"
        )
    return _as_float64(matrix.ravel())


def _as_float64(column: np.ndarray[Any, Any]) -> FloatArray:
    with np.errstate(invalid="ignore"):  # of a signalling NaN, which is refused later like any other
        return np.ascontiguousarray(column, dtype=np.float64)
