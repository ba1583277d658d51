"""Open recordings with one fault each: one line that names the file, the line and the column, or the key."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from benchctl.recordings.import_open import read_open_recording
from benchctl.recordings.importing import import_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings.open_folder import HEADER, description, rows, write_open


def refusal(folder: Path) -> str:
    """What the import says; it leaves nothing behind."""
    output = folder.parent / "out" / "recording.h5"
    output.parent.mkdir(exist_ok=True)
    with pytest.raises(UsageError) as caught:
        import_recording(folder, None, output)
    assert list(output.parent.iterdir()) == []
    message = str(caught.value)
    assert "\n" not in message
    assert str(folder) in message
    return message


def cells(row: int, **changes: str) -> list[str]:
    """Rows of which one has other cells."""
    body = rows()
    names = HEADER.split(",")
    body[row] = ",".join(changes.get(name, cell) for name, cell in zip(names, body[row].split(","), strict=True))
    return body


BAD_ROWS: dict[str, tuple[list[str], str]] = {
    "not a number": (cells(7, gyro_v="hello"), "line 9, column gyro_v: expected a number, got 'hello'"),
    "an empty cell": (cells(7, gyro_temp_c=""), "line 9, column gyro_temp_c: expected a number, the cell is empty"),
    "NaN": (cells(7, encoder_deg="nan"), "line 9, column encoder_deg: expected a finite number, got nan"),
    "infinity": (cells(0, gyro_v="-inf"), "line 2, column gyro_v: expected a finite number, got -inf"),
    "too few cells": (
        [*rows()[:3], "0.300000,6.0,0.003"],
        "line 5: expected 5 cells, got 3 cells: the column gyro_temp_c",
    ),
    "too many cells": ([*rows()[:3], rows()[3] + ",1"], "line 5: expected 5 cells, got 6"),
    "a blank line within": ([*rows()[:3], "", *rows()[3:]], "line 5: expected 5 cells, got 1 cell"),
    "a stamp that goes back": (
        cells(5, time_s="0.100000"),
        "line 7, column time_s: the stamp 0.1 s goes back from 0.4",
    ),
    "a stamp twice": (cells(5, time_s="0.400000"), "line 7, column time_s: the stamp 0.4 s repeats that of the row"),
    "a gap": (rows()[:8] + rows()[11:], "line 10, column time_s: a gap: 0.4 s after the row before"),
    "a stamp off the clock": (
        cells(5, time_s="0.510000"),
        "line 7, column time_s: the stamp 0.51 s is not uniform at 10",
    ),
    "another rate": (
        [line.replace(line[:8], f"{k / 9.99:.6f}", 1) for k, line in enumerate(rows())],
        "line 4, column time_s: the stamp 0.2002 s is not uniform at 10 Hz",
    ),
    "an angle beyond the turn": (
        cells(9, encoder_deg="4711.0"),
        "line 11, column encoder_deg: 4711 is outside 0 to 360",
    ),
    "no rows": ([], "has no samples"),
}


@pytest.mark.parametrize("fault", BAD_ROWS)
def test_a_fault_in_the_samples_is_named_by_line_and_column(tmp_path: Path, fault: str) -> None:
    body, says = BAD_ROWS[fault]
    message = refusal(write_open(tmp_path / "bench", body=body)).replace("samples.csv.gz: ", "samples.csv.gz, ")
    assert f"samples.csv.gz, {says}" in message


def _without(*path: str) -> Callable[[dict[str, Any]], None]:
    def spoil(raw: dict[str, Any]) -> None:
        for key in path[:-1]:
            raw = raw[key]
        del raw[path[-1]]

    return spoil


def _with(value: object, *path: str | int) -> Callable[[dict[str, Any]], None]:
    def spoil(raw: Any) -> None:
        for key in path[:-1]:
            raw = raw[key]
        raw[path[-1]] = value

    return spoil


BAD_KEYS: dict[str, tuple[Callable[[dict[str, Any]], None], str]] = {
    "another format": (
        _with("open-recording/9", "format"),
        "recording.json: format: expected 'open-recording/1'",
    ),
    "no format": (_without("format"), "format: this field is needed"),
    "no unit": (_without("unit"), "unit: this field is needed"),
    "no serial": (_without("unit", "serial"), "unit.serial: this field is needed"),
    "a number as text": (
        _with("10", "bench", "sample_rate_hz"),
        "bench.sample_rate_hz: expected a number",
    ),
    "a rate of zero": (_with(0, "bench", "sample_rate_hz"), "bench.sample_rate_hz: expected a number above 0"),
    "no simulation": (_without("simulation"), "simulation: this field is needed"),
    "a model without k_T": (_without("simulation", "k_T"), "simulation.k_T: this field is needed"),
    "a list as a number": (_with(1e-4, "simulation", "k_T"), "simulation.k_T: expected a list"),
    "steps as a mapping": (_with({}, "steps"), "steps: expected a list"),
    "an unknown kind": (_with("spin", "steps", 1, "kind"), "steps[1].kind: expected 'static'"),
    "a rate step without a rate": (_with(None, "steps", 1, "rate_dps"), "steps[1]: a step of kind constant_rate needs"),
    "a sine without a frequency": (
        _with("sine", "steps", 1, "kind"),
        "steps[1]: a step of kind sine needs amplitude_dps",
    ),
    "a step that ends first": (_with(0.5, "steps", 1, "t_end"), "steps[1]: ends at 0.5 s, not after its start at 1 s"),
    "no start": (lambda raw: raw["steps"][0].pop("t_start"), "steps[0].t_start: this field is needed"),
    "no set point": (
        lambda raw: raw["steps"][0].pop("chamber_setpoint_c"),
        "steps[0].chamber_setpoint_c: this field is",
    ),
    "two steps that overlap": (
        _with(0.9, "steps", 1, "t_start"),
        "steps[1]: 'turn' starts at 0.9 s, before 'rest' ends",
    ),
    "a step behind the samples": (_with(4.3, "steps", 1, "t_end"), "steps[1]: 'turn' from 1 to 4.3 s reaches beyond"),
    "a step before the samples": (_with(-1.0, "steps", 0, "t_start"), "steps[0]: 'rest' from -1 to 1 s reaches beyond"),
}


@pytest.mark.parametrize("fault", BAD_KEYS)
def test_a_fault_in_the_description_is_named_by_key(tmp_path: Path, fault: str) -> None:
    spoil, says = BAD_KEYS[fault]
    raw = description()
    spoil(raw)
    folder = write_open(tmp_path / "bench")
    (folder / "recording.json").write_text(json.dumps(raw))
    assert says in refusal(folder)


def test_a_step_between_two_samples_holds_none_and_is_refused(tmp_path: Path) -> None:
    raw = description()
    raw["steps"][1] |= {"t_start": 1.02, "t_end": 1.08}
    assert "steps[1]: 'turn' from 1.02 to 1.08 s holds no sample" in refusal(write_open(tmp_path / "bench", **raw))


@pytest.mark.parametrize("missing", HEADER.split(","))
def test_a_missing_column_is_named(tmp_path: Path, missing: str) -> None:
    header = HEADER.replace(missing, "other")
    assert f"samples.csv.gz, line 1: the column {missing} is missing" in refusal(
        write_open(tmp_path / "bench", header=header)
    )


def test_a_column_that_is_there_twice_is_named(tmp_path: Path) -> None:
    header = HEADER.replace("chamber_temp_c", "gyro_v")
    assert "line 1: the column 'gyro_v' is there twice" in refusal(write_open(tmp_path / "bench", header=header))


def test_a_truncated_gzip_says_how_far_it_goes(tmp_path: Path) -> None:
    folder = write_open(tmp_path / "bench", body=rows(3000))
    packed = (folder / "samples.csv.gz").read_bytes()
    (folder / "samples.csv.gz").write_bytes(packed[: len(packed) // 2])
    message = refusal(folder)
    assert "samples.csv.gz: the gzip stream is cut short after line " in message
    assert 100 < int(message.split("after line ")[1].split(";")[0]) < 2900


def test_a_damaged_gzip_is_not_taken_for_data(tmp_path: Path) -> None:
    folder = write_open(tmp_path / "bench", body=rows(3000))
    packed = bytearray((folder / "samples.csv.gz").read_bytes())
    packed[-6] ^= 0xFF
    (folder / "samples.csv.gz").write_bytes(packed)
    assert "samples.csv.gz: not a sound gzip file" in refusal(folder)


@pytest.mark.parametrize("name", ["recording.json", "samples.csv.gz"])
def test_an_empty_file_is_named(tmp_path: Path, name: str) -> None:
    folder = write_open(tmp_path / "bench")
    (folder / name).write_bytes(b"")
    assert name in (message := refusal(folder))
    assert "empty" in message or "not a sound gzip" in message or "cut short" in message


def test_text_that_is_no_json_is_named_by_line(tmp_path: Path) -> None:
    folder = write_open(tmp_path / "bench")
    (folder / "recording.json").write_text('{\n"format": open\n}')
    assert "recording.json, line 2: not JSON" in refusal(folder)


def test_a_folder_without_samples_or_with_two_is_refused(tmp_path: Path) -> None:
    folder = write_open(tmp_path / "bench")
    (folder / "samples.csv").write_text("x")
    assert "holds samples.csv.gz and samples.csv" in refusal(folder)
    (folder / "samples.csv").unlink()
    (folder / "samples.csv.gz").unlink()
    assert "holds neither samples.csv.gz nor samples.csv" in refusal(folder)


def test_a_csv_that_ends_in_the_middle_of_a_row_is_refused(tmp_path: Path) -> None:
    folder = write_open(tmp_path / "bench")
    (folder / "samples.csv.gz").unlink()
    (folder / "samples.csv").write_text("\n".join([HEADER, *rows()])[:-15])
    with pytest.raises(UsageError, match=r"samples\.csv, line 41: expected 5 cells, got 3 cells"):
        read_open_recording(folder)
