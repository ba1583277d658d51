"""Read the variables that a map selects from a MATLAB file, versions 5 to 7.3, which is HDF5.

scipy trusts the sizes in the file's headers, and follows nested cells to any depth. Therefore a child process with
limits reads the variables, and writes them to its stdout in numpy's format.
"""

from __future__ import annotations

import io
import sys
import warnings
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import loadmat, whosmat
from scipy.io.matlab import MatReadError, MatReadWarning, matfile_version

from benchctl.limits import cut, listed, memory_bytes, require_file
from benchctl.own_process import limit_itself, run_limited
from benchctl.recordings.column_map import ColumnMap, RawColumns, Wanted, raw_columns, wanted_columns
from benchctl.recordings.hdf5_guard import attribute, check_samples, child, names_in, plain_errors
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError, reason

_MOST_ROWS = 1 << 53
_NUMERIC = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
_HDF5 = 2
"""The major version in the header of a file of version 7.3."""
_REFUSED = 2
"""The child's exit status if it reports the reason."""
_LEAST_S, _BYTES_PER_S = 20.0, 1e6
"""Processor time for a file: a minimum, and bytes per second."""
_MEMORY_SHARE, _UNKNOWN_BYTES = 0.9, 4 << 30
"""Share of the machine's memory that may be used; if that is not known (Windows), nothing is limited."""


def read_mat(path: Path, mapping: ColumnMap) -> RawColumns:
    """Return the mapped variables of a MAT file, from the first row that the map states.

    Raises
    ------
    UsageError
        Not a MAT file, a variable that does not exist or is not a column of numbers, columns of different lengths.
    """
    wanted = wanted_columns(mapping)
    first_variable = mapping.file.first_row_variable
    names = {str(column.column) for column in wanted.values()} | ({first_variable} if first_variable else set())
    variables = _load(path, names)
    first = mapping.file.first_line or 1
    if first_variable is not None:
        first = _first_row(path, first_variable, variables[first_variable])
    columns = {channel: _column(path, column, variables[str(column.column)]) for channel, column in wanted.items()}
    return raw_columns(path, columns, wanted, first)


def _load(path: Path, names: set[str]) -> dict[str, Any]:
    require_file(path)
    try:
        limit_s = _LEAST_S + path.stat().st_size / _BYTES_PER_S
    except OSError as err:
        raise UsageError(f"{path}: cannot be read: {reason(err)}") from err
    status, written = run_limited(__name__, [str(path), str(limit_s), *sorted(names)], limit_s)
    if status == _REFUSED:
        raise UsageError(written.decode("utf-8"))
    if status:
        raise UsageError(
            f"{path}: cannot be read in {limit_s:.0f} s and {_most_bytes() / 1e9:.3g} GB of memory; "
            "save it anew, or in parts"
        )
    stream = io.BytesIO(written)
    return {name: np.load(stream, allow_pickle=False) for name in sorted(names)}


def main(path: Path, limit_s: float, names: list[str]) -> int:
    """Write variables to stdout as `numpy.save` does, or why they cannot be read; return the exit status."""
    limit_itself(limit_s, _most_bytes())
    try:
        found = _variables(path, names)
    except UsageError as err:
        sys.stdout.buffer.write(str(err).encode("utf-8", "replace"))
        return _REFUSED
    for name in names:
        np.save(sys.stdout.buffer, found[name], allow_pickle=False)
    return 0


def _most_bytes() -> int:
    return round((memory_bytes() or _UNKNOWN_BYTES) * _MEMORY_SHARE)


def _variables(path: Path, names: list[str]) -> dict[str, Any]:
    file = str(path)
    try:
        version, _ = matfile_version(file, appendmat=False)
        if version == _HDF5:
            return _hdf5_variables(path, names)
        if version == 0:
            raise UsageError(f"{path}: a MAT file of version 4; save it with MATLAB's option -v7")
        with warnings.catch_warnings():
            warnings.simplefilter("error", MatReadWarning)
            there = [(name, str(kind)) for name, _, kind in whosmat(file, appendmat=False)]
            for name in names:
                _check_variable(path, name, there)
            loaded: dict[str, Any] = loadmat(file, appendmat=False, variable_names=names)
    except OSError as err:
        raise UsageError(f"{path}: cannot be read: {reason(err)}") from err
    except (MatReadError, MatReadWarning, ValueError, TypeError, LookupError, EOFError, MemoryError, zlib.error) as err:
        raise UsageError(f"{path}: not a MAT file of version 5 to 7, or cut short: {cut(str(err))}") from err
    return loaded


def _hdf5_variables(path: Path, names: list[str]) -> dict[str, Any]:
    """Return matrices of numbers from a file of version 7.3, which stores them transposed."""
    loaded: dict[str, Any] = {}
    try:
        with plain_errors(), h5py.File(path, "r") as file:
            there = [(name, _class_of(child(file, name))) for name in names_in(file) if not name.startswith("#")]
            for name in names:
                _check_variable(path, name, there)
                dataset = child(file, name)
                check_samples(dataset)
                loaded[name] = dataset[()].T
    except ValueError as err:
        raise UsageError(f"{path}: not a MAT file of version 7.3, or cut short: {cut(str(err))}") from err
    return loaded


def _class_of(item: Any) -> str:
    """Return the MATLAB class of a variable, or the type of its numbers if another program wrote the file."""
    if not isinstance(item, h5py.Dataset):
        return "struct"
    return str(attribute(item, "MATLAB_class", "double" if item.dtype.kind in "iuf" else str(item.dtype)))


def _check_variable(path: Path, name: str, there: list[tuple[str, str]]) -> None:
    """Raise `UsageError` if a variable does not exist exactly once, or is not a matrix of numbers."""
    kinds = [kind for other, kind in there if other == name]
    if not kinds:
        raise UsageError(f"{path}: the variable {name!r} of the map is missing among {listed([n for n, _ in there])}")
    if len(kinds) > 1:
        raise UsageError(f"{path}: the variable {name!r} is there twice; save the file again")
    if kinds[0] not in _NUMERIC:
        raise UsageError(f"{path}: {name} is not a column of numbers but of class {kinds[0]}; name another")


def _first_row(path: Path, name: str, value: Any) -> int:
    found = np.asarray(value)
    if found.size != 1 or found.dtype.kind not in "iuf" or not 1 <= found.ravel()[0] <= _MOST_ROWS:
        raise UsageError(f"{path}: {name} should hold one row number from 1, it holds {found.dtype} {found.shape}")
    return int(found.ravel()[0])


def _column(path: Path, wanted: Wanted, value: Any) -> FloatArray:
    """Return one column of numbers, shape (rows,)."""
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
    with np.errstate(invalid="ignore"):  # a signalling NaN, which is refused later like any other
        return np.ascontiguousarray(column, dtype=np.float64)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), float(sys.argv[2]), sys.argv[3:]))
