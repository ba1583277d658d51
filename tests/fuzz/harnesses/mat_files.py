"""MAT files of version 5 to 7."""

from __future__ import annotations

import io

import numpy as np
from scipy.io import savemat

from benchctl.recordings.column_map import ColumnMap, parse_map
from benchctl.recordings.import_mat import read_mat
from tests.fuzz.harness import Harness, refusals, workplace
from tests.fuzz.harnesses.toml_files import MAP

_MAPS: list[ColumnMap] = [
    parse_map(MAP.replace("column = 4", 'column = "coil"'), "map.toml"),
    parse_map(
        MAP.replace("column = 4", 'column = "coil"\nindex = 2').replace(
            "[time]", '[file]\nfirst_row_variable = "first"\n[time]'
        ),
        "map.toml",
    ),
]


def one_input(data: bytes) -> None:
    path = workplace() / "log.mat"
    path.write_bytes(data)
    for mapping in _MAPS:
        with refusals():
            assert read_mat(path, mapping).values["gyro_v"].size > 0


def seeds() -> list[bytes]:
    column = np.arange(12.0)[:, np.newaxis]
    coil = np.arange(24, dtype=np.int16).reshape(12, 2)
    variables = {"t": column, "angle": column.astype(np.float32), "out": column.T, "first": 2}
    return [
        _mat(variables | {"coil": coil[:, :1]}, packed=True),
        _mat(variables | {"coil": coil}, packed=False),
        _mat(variables | {"coil": coil, "note": "text", "cell": np.array([column, "x"], dtype=object)}, packed=False),
        _mat({"s": {"t": {"u": column}}, "z": column + 1j, **variables}, packed=True),
    ]


def _mat(variables: dict[str, object], *, packed: bool) -> bytes:
    file = io.BytesIO()
    savemat(file, variables, do_compression=packed)
    return file.getvalue()


HARNESS = Harness(
    name="mat_files",
    weight=80,
    one_input=one_input,
    seeds=seeds,
    tokens=(b"\x0e\0\0\0", b"\x0f\0\0\0", b"MI", b"\x78\x9c"),
)
