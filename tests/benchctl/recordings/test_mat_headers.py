"""MAT files from strangers: what their headers promise is held against their bytes before anybody unpacks them."""

from __future__ import annotations

import io
import struct
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from benchctl.recordings.column_map import parse_map
from benchctl.recordings.import_mat import read_mat
from benchctl.recordings.mat_headers import Variable, variables_in
from instruments.errors import UsageError
from tests.slowness import slowness

MAP = parse_map(
    """
    [unit]
    serial = "G1"
    [time]
    rate_hz = 10.0
    [channels.gyro_v]
    column = "out"
    unit = "V"
    """,
    "map.toml",
)

COLUMN = np.arange(1000.0)[:, np.newaxis]
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
def test_the_headers_of_sound_files_are_read(packed: bool) -> None:
    variables = {"out": COLUMN, "s": np.int8(3), "k": {"a": COLUMN}, "z": COLUMN + 1j, "note": "text"}
    found = {variable.name: variable for variable in variables_in(io.BytesIO(saved(variables, packed=packed)))}
    assert found["out"] == Variable("out", (1000, 1), True)
    assert found["s"] == Variable("s", (1, 1), True)
    assert {name for name, variable in found.items() if variable.numeric} == {"out", "s"}


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from(["f8", "f4", "i1", "u2", "i4", "u8"]),
    st.integers(1, 40),
    st.booleans(),
    st.from_regex("[a-z][a-z0-9_]{0,20}", fullmatch=True),
)
def test_columns_of_every_type_come_back(tmp_path: Path, dtype: str, rows: int, packed: bool, beside: str) -> None:
    column = np.arange(rows).astype(dtype)[:, np.newaxis]
    path = tmp_path / "log.mat"
    path.write_bytes(saved({beside: column[::-1], "out": column}, packed=packed))
    assert read_mat(path, MAP).values["gyro_v"].tolist() == list(range(rows))


def test_a_matrix_made_by_hand_is_read(tmp_path: Path) -> None:
    (tmp_path / "log.mat").write_bytes(HEADER + matrix((1000, 1), COLUMN.tobytes()))
    assert np.array_equal(read_mat(tmp_path / "log.mat", MAP).values["gyro_v"], COLUMN[:, 0])


def test_a_shape_that_its_bytes_do_not_fill_is_refused(tmp_path: Path) -> None:
    shape = (2**31 - 1, 2**31 - 1)
    assert "of shape (2147483647, 2147483647) has 8000 bytes" in refusal(
        tmp_path, HEADER + matrix(shape, COLUMN.tobytes())
    )


def test_a_length_beyond_the_file_is_refused(tmp_path: Path) -> None:
    lying = matrix((1 << 28, 1), COLUMN.tobytes(), length=1 << 31)
    assert "has 2147483648 bytes of type 9" in refusal(tmp_path, HEADER + lying)
    assert "does not fit into the" in refusal(tmp_path, HEADER + element(14, bytes(100), 1 << 31))


def test_a_shape_below_zero_is_refused(tmp_path: Path) -> None:
    assert "a variable of shape (-1000, -1)" in refusal(tmp_path, HEADER + matrix((-1000, -1), COLUMN.tobytes()))


def test_packed_bytes_that_promise_too_much_are_refused(tmp_path: Path) -> None:
    inner = element(14, matrix((1 << 28, 1), bytes(100), length=1 << 31)[8:], (1 << 31) + 200)
    message = refusal(tmp_path, HEADER + element(15, zlib.compress(inner)))
    assert "packed bytes promise 2147483848 bytes of type 14" in message


def test_a_name_of_megabytes_in_a_packed_header_is_refused(tmp_path: Path) -> None:
    inner = matrix((1, 1), bytes(8), name=b"x" * (4 << 20))
    assert "a variable ends within its header" in refusal(tmp_path, HEADER + element(15, zlib.compress(inner)))


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
        ({"out": "text"}, "out is not a column of numbers but text"),
        ({"out": {"a": 1}}, "out is not a column of numbers but text, a cell, a structure"),
        ({"out": COLUMN + 1j}, "complex"),
        ({"x": COLUMN}, "the variable 'out' of the map is missing among x"),
    ],
)
def test_what_is_no_column_is_told_before_it_is_loaded(tmp_path: Path, variables: dict[str, Any], says: str) -> None:
    assert says in refusal(tmp_path, saved(variables))


def test_a_variable_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    content = saved({"out": COLUMN})
    assert "the variable 'out' is there twice" in refusal(tmp_path, content + content[128:])


def test_files_of_other_versions_are_told_so(tmp_path: Path) -> None:
    assert "a MAT file of version 4" in refusal(tmp_path, saved({"out": COLUMN}, version="4"))
    assert "a MAT file of version 7.3" in refusal(tmp_path, b"MATLAB 7.3".ljust(124) + b"\x00\x02IM" + bytes(600))


def test_a_version_4_whose_sizes_are_below_zero_ends(tmp_path: Path) -> None:
    """scipy would walk it backwards, and then again, for ever."""
    assert "version 4" in refusal(tmp_path, struct.pack("<5i", 0, -1, 100, 0, 4) + b"out\0" + bytes(1000))


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_no_bytes_whatever_break_the_reader(tmp_path: Path, data: st.DataObject) -> None:
    content = bytearray(saved({"out": COLUMN[:5]}, packed=data.draw(st.booleans())))
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place : place + 1] = data.draw(st.binary(max_size=4))
        content = content or bytearray(b"\0")
    (tmp_path / "log.mat").write_bytes(content)
    try:
        read_mat(tmp_path / "log.mat", MAP)
    except UsageError as err:
        assert len(str(err)) < 2000  # noqa: PT017 - either is an answer
