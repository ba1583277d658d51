"""Delimited text with and without a map, packed with gzip or not: `map.toml`, a separator, and the table's bytes."""

from __future__ import annotations

import gzip

from benchctl.recordings.importing import read_foreign
from benchctl.recordings.writer import write_recording
from tests.fuzz.harness import Harness, refusals, workplace
from tests.fuzz.harnesses.toml_files import MAP, POINTS_MAP

_SEPARATOR = b"\n====\n"


def one_input(data: bytes) -> None:
    mapping, _, table = data.partition(_SEPARATOR)
    folder = workplace()
    source, map_file = folder / "log.csv", folder / "map.toml"
    source.write_bytes(table)
    map_file.write_bytes(mapping)
    with refusals():
        meta, steps = read_foreign(source, map_file if mapping else None)
        write_recording(folder / "made.h5", meta, steps)  # what was read can be kept


def seeds() -> list[bytes]:
    rows = b"".join(b"%d,%d,%.3f,%.1f\n" % (100 * k, 400 * k, 0.01 * k, k) for k in range(30))
    table = b"t,angle,out,coil\n" + rows
    semicolons = MAP.replace("[time]", '[file]\ndelimiter = ";"\ndecimal = ","\nheader_line = 2\n[time]')
    return [
        MAP.encode() + _SEPARATOR + table,
        MAP.encode() + _SEPARATOR + gzip.compress(table, mtime=0),
        semicolons.encode() + _SEPARATOR + b"# x\n" + table.replace(b",", b";").replace(b".", b","),
        POINTS_MAP.encode() + _SEPARATOR + b"r,m\n-1,0.5\n0,1\n1,1.5\n",
        _SEPARATOR + b"run,rate_dps,gyro_v_mean,gyro_v_std,unit\n1,-10,-0.2,1e-3,A\n1,10,0.2,1e-3,A\n",
    ]


HARNESS = Harness(
    name="tables",
    weight=10,
    one_input=one_input,
    seeds=seeds,
    tokens=(_SEPARATOR, b"rate_dps,gyro_v_mean", b"nan", b"1e999", b"\x1f\x8b\x08", b"\x85", b"\xef\xbb\xbf", b"\r"),
)
