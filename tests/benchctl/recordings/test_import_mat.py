"""MAT files, also from strangers: what their headers promise costs this process nothing."""

from __future__ import annotations

import io
import struct
import time
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from benchctl.recordings.column_map import parse_map
from benchctl.recordings.import_mat import read_mat
from benchctl_instruments.errors import UsageError
from tests.slowness import slowness

MAP_TEXT = """
[unit]
serial = "G1"
[time]
rate_hz = 10.0
[channels.gyro_v]
column = "out"
unit = "V"
"""
MAP = parse_map(MAP_TEXT, "map.toml")

COLUMN = np.arange(1000.0)[:, np.newaxis]
HEADER_73 = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
HEADER = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"


def saved(variables: dict[str, Any], *, packed: bool = False, version: str = "5") -> bytes:
    file = io.BytesIO()
    savemat(file, variables, do_compression=packed, format=version)
    return file.getvalue()


def element(kind: int, data: bytes, length: int | None = None) -> bytes:
    """One element, which may lie about its length."""
    return struct.pack("<II", kind, len(data) if length is None else length) + data + bytes(-len(data) % 8)


def matrix(
    shape: tuple[int, ...], numbers: bytes, *, name: bytes = b"out", flags: int = 6, length: int | None = None
) -> bytes:
    """A miMATRIX of doubles, its shape whatever it is said to be."""
    return element(
        14,
        element(6, struct.pack("<II", flags, 0))
        + element(5, struct.pack(f"<{len(shape)}i", *shape))
        + element(1, name)
        + element(9, numbers, length),
    )


def refusal(folder: Path, content: bytes) -> str:
    path = folder / "log.mat"
    path.write_bytes(content)
    begun = time.process_time()
    with pytest.raises(UsageError) as caught:
        read_mat(path, MAP)
    assert time.process_time() - begun < 1.0 * slowness()
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("dtype", ["f8", "f4", "i1", "u2", "i4", "u8"])
def test_columns_of_every_type_come_back(tmp_path: Path, dtype: str, packed: bool) -> None:
    column = np.arange(40).astype(dtype)[:, np.newaxis]
    path = tmp_path / "log.mat"
    path.write_bytes(saved({"beside": column[::-1], "out": column, "z": column + 1j, "note": "text"}, packed=packed))
    assert read_mat(path, MAP).values["gyro_v"].tolist() == list(range(40))


def test_a_matrix_made_by_hand_is_read(tmp_path: Path) -> None:
    (tmp_path / "log.mat").write_bytes(HEADER + matrix((1000, 1), COLUMN.tobytes()))
    assert np.array_equal(read_mat(tmp_path / "log.mat", MAP).values["gyro_v"], COLUMN[:, 0])


LIES = {
    "a shape that its bytes do not fill": matrix((2**31 - 1, 2**31 - 1), COLUMN.tobytes()),
    "numbers beyond the file": matrix((1 << 28, 1), COLUMN.tobytes(), length=1 << 31),
    "a variable beyond the file": element(14, bytes(100), 1 << 31),
    "a shape below zero": matrix((-1000, -1), COLUMN.tobytes()),
    "packed bytes that promise gigabytes": element(
        15, zlib.compress(element(14, matrix((1 << 28, 1), bytes(100), length=1 << 31)[8:], (1 << 31) + 200))
    ),
    "a name of megabytes": element(15, zlib.compress(matrix((1, 1), bytes(8), name=b"x" * (4 << 20)))),
}


@pytest.mark.parametrize("lie", LIES)
def test_what_a_header_promises_without_having_it_is_refused_in_one_line(tmp_path: Path, lie: str) -> None:
    refusal(tmp_path, HEADER + LIES[lie])


def cell(name: bytes, inner: bytes) -> bytes:
    """A cell of one cell or matrix."""
    flags, shape = struct.pack("<II", 1, 0), struct.pack("<2i", 1, 1)
    return element(14, element(6, flags) + element(5, shape) + element(1, name) + inner)


def test_cells_nested_until_the_stack_ends_are_never_entered(tmp_path: Path) -> None:
    nested = matrix((1, 1), bytes(8), name=b"")
    for _ in range(3000):
        nested = cell(b"", nested)
    (tmp_path / "beside.mat").write_bytes(saved({"out": COLUMN}) + cell(b"other", nested))
    assert read_mat(tmp_path / "beside.mat", MAP).values["gyro_v"].size == 1000
    assert "out is not a column of numbers" in refusal(tmp_path, HEADER + cell(b"out", nested))


@pytest.mark.parametrize(
    ("variables", "says"),
    [
        ({"out": "text"}, "out is not a column of numbers but of class char"),
        ({"out": {"a": 1}}, "out is not a column of numbers but of class struct"),
        ({"out": COLUMN + 1j}, "complex"),
        ({"x": COLUMN}, "the variable 'out' of the map is missing among x"),
    ],
)
def test_what_is_no_column_is_refused(tmp_path: Path, variables: dict[str, Any], says: str) -> None:
    assert says in refusal(tmp_path, saved(variables))


def test_a_variable_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    content = saved({"out": COLUMN})
    assert "the variable 'out' is there twice" in refusal(tmp_path, content + content[128:])


def test_files_of_other_versions_are_told_so(tmp_path: Path) -> None:
    assert "a MAT file of version 4" in refusal(tmp_path, saved({"out": COLUMN}, version="4"))
    assert "not a MAT file of version 7.3, or cut short" in refusal(tmp_path, HEADER_73 + bytes(600))


def hdf5_mat(path: Path, **variables: Any) -> Path:
    """A file as MATLAB's option -v7.3 writes it: HDF5 behind a header of MATLAB's, matrices transposed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in variables.items():
            file[name] = values.T if isinstance(values, np.ndarray) else values
    with path.open("r+b") as file:
        file.write(HEADER_73)
    return path


def test_a_file_of_version_7_3_holds_the_same_columns(tmp_path: Path) -> None:
    raw = read_mat(hdf5_mat(tmp_path / "log.mat", out=COLUMN), MAP)
    np.testing.assert_array_equal(raw.values["gyro_v"], COLUMN[:, 0])


def test_a_column_of_a_matrix_of_version_7_3_is_the_one_that_matlab_shows(tmp_path: Path) -> None:
    matrix = np.arange(30.0).reshape(10, 3)
    mapping = parse_map(MAP_TEXT + "index = 3\n", "map.toml")
    raw = read_mat(hdf5_mat(tmp_path / "log.mat", out=matrix), mapping)
    np.testing.assert_array_equal(raw.values["gyro_v"], matrix[:, 2])


def test_a_variable_of_version_7_3_that_is_missing_or_elsewhere_is_refused(tmp_path: Path) -> None:
    for variables, says in (
        ({"other": COLUMN}, "'out' of the map is missing among"),
        ({"out": h5py.ExternalLink("/etc/passwd", "/x")}, "external link"),
        ({"out": "text"}, "not a column of numbers"),
    ):
        with pytest.raises(UsageError, match=says):
            read_mat(hdf5_mat(tmp_path / "log.mat", **variables), MAP)


def test_a_version_4_whose_sizes_are_below_zero_ends(tmp_path: Path) -> None:
    """scipy would walk it backwards, and then again, for ever."""
    assert "version 4" in refusal(tmp_path, struct.pack("<5i", 0, -1, 100, 0, 4) + b"out\0" + bytes(1000))


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_a_damaged_file_is_read_or_refused_in_one_line(tmp_path: Path, seed: int, packed: bool) -> None:
    chance = np.random.default_rng(seed)
    content = bytearray(saved({"out": COLUMN[:5]}, packed=packed))
    for place in chance.integers(0, len(content), 4):
        content[place] = chance.integers(256)
    (tmp_path / "log.mat").write_bytes(content[: chance.integers(1, 2 * len(content))])
    try:
        assert read_mat(tmp_path / "log.mat", MAP).values["gyro_v"].size > 0
    except UsageError as err:
        assert "\n" not in str(err)  # noqa: PT017 - either is an answer
