"""A stranger's file to a diagnosis in three steps, a map, import, diagnose: one recording in five formats."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from benchctl.cli.app import run_verb

RATE_HZ, K0, EVEN = 100.0, 0.02, 2e-5
MAP = """
[unit]
serial = "theirs"
range_dps = 100
[file]
{file}
[time]
column = {time}
[channels.encoder_deg]
column = {angle}
unit = "deg"
[channels.gyro_v]
column = {volts}
unit = "V"
"""


def _columns() -> dict[str, np.ndarray]:
    """A sine whose amplitude swells; the output has a part in the square of the rate."""
    time_s = np.arange(0.0, 90.0, 1.0 / RATE_HZ)
    rate = (50.0 + 30.0 * np.sin(2 * np.pi * time_s / 45.0)) * np.sin(2 * np.pi * 0.5 * time_s)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1])) / RATE_HZ])
    noise = 5e-4 * np.random.default_rng(5).standard_normal(time_s.size)
    return {"t": time_s, "angle": angle, "volts": K0 * rate + EVEN * rate**2 + noise}


def _csv(path: Path, columns: dict[str, np.ndarray]) -> None:
    np.savetxt(path, np.stack(list(columns.values()), 1), "%.9g", ";", header=";".join(columns), comments="")


def _dat(path: Path, columns: dict[str, np.ndarray]) -> None:
    np.savetxt(path, np.stack(list(columns.values()), 1), "  %.9e")


def _mat(path: Path, columns: dict[str, np.ndarray]) -> None:
    scipy.io.savemat(path, columns)


def _json(path: Path, columns: dict[str, np.ndarray]) -> None:
    path.write_text(json.dumps({name: values.tolist() for name, values in columns.items()}), encoding="utf-8")


def _sqlite(path: Path, columns: dict[str, np.ndarray]) -> None:
    with closing(sqlite3.connect(path)) as base, base:
        base.execute("CREATE TABLE samples (t REAL, angle REAL, volts REAL)")
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        base.executemany("INSERT INTO samples VALUES (?, ?, ?)", rows)


NAMES, NUMBERS = ("'t'", "'angle'", "'volts'"), ("1", "2", "3")
KINDS: list[tuple[str, Callable[[Path, dict[str, np.ndarray]], None], str, tuple[str, str, str]]] = [
    ("log.csv", _csv, 'delimiter = ";"', NAMES),
    ("log.dat", _dat, 'delimiter = " "\nheader_line = 0\nfirst_line = 1', NUMBERS),
    ("log.mat", _mat, "", NAMES),
    ("log.json", _json, "", NAMES),
    ("log.db", _sqlite, 'table = "samples"', NAMES),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "write", "file", "columns"), KINDS, ids=[name for name, *_ in KINDS])
def test_every_format_comes_to_the_same_diagnosis(
    name: str,
    write: Callable[[Path, dict[str, np.ndarray]], None],
    file: str,
    columns: tuple[str, str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path(name), _columns())
    time, angle, volts = columns
    Path("map.toml").write_text(MAP.format(file=file, time=time, angle=angle, volts=volts), encoding="utf-8")
    assert run_verb(["import", name, "--map", "map.toml", "-o", "theirs.h5", "--quiet"]) == 0
    assert run_verb(["diagnose", "theirs.h5", "--json", "d.json", "--quiet"]) == 0
    found = json.loads(Path("d.json").read_text(encoding="utf-8"))
    (squared,) = found["findings"]
    assert squared["effect"] == "rate_squared"
    assert squared["parameters"]["v_per_dps2"]["value"] == pytest.approx(EVEN, rel=0.03)
