"""What the attributes of a recording may say: text, finite numbers, and JSON of the shapes that this program knows."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from benchctl.recordings.descriptions import read_info
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made


def _spoilt(folder: Path, place: str, name: str, value: Any) -> Path:
    path = made.recording(folder, 1)
    with made.changed(path) as file:
        file[place].attrs[name] = value
    return path


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("index", "one", "index is 'one', expected an integer"),
        ("index", -1, "index is -1, expected an integer"),
        ("index", 1.5, "index is 1.5, expected an integer"),
        ("samples", np.inf, "samples is inf, expected an integer"),
        ("whole", 7.5, "whole is 7.5, expected 0 or 1"),
        ("name", 5, "name is 5, expected text"),
        ("t_start", "now", "t_start is 'now', expected a finite number"),
        ("t_end", np.nan, "t_end is nan, expected a finite number"),
        ("frequency_hz", np.inf, "frequency_hz is inf, expected a finite number"),
    ],
)
def test_a_step_says_what_it_says_in_the_right_type_or_not_at_all(
    tmp_path: Path, name: str, value: Any, says: str
) -> None:
    path = _spoilt(tmp_path, "steps/0001", name, value)
    with pytest.raises(UsageError) as caught:
        open_recording(path)
    assert f"{path}: its description is damaged (step '0001': {says}" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("status", 1, "status is 1, expected text"),
        ("unit_serial", 3.0, "serial is 3.0, expected text"),
        ("unit_colour", "red", "there is no colour in a Unit"),
        ("bench_adc_bits", -3, "adc_bits is -3, expected an integer"),
        ("provenance_operator", 1, "operator is 1, expected text"),
        ("extra", 1, "extra is 1, expected JSON"),
        ("extra", "[1]", "extra: expected a table"),
        ("extra", '{"channel_units": {"gyro_v": 1}}', "extra.channel_units.gyro_v: expected text"),
        (
            "extra",
            '{"csv_decimals": {"time_s": 1000000000}}',
            "extra.csv_decimals.time_s: expected a number of at most",
        ),
        ("extra", '{"csv_decimals": {"time_s": "9f%s"}}', "extra.csv_decimals.time_s: expected an integer"),
        ("extra", '{"foreign_keys": {"steps": 1}}', "extra.foreign_keys.steps: expected a table"),
        ("simulation", "[1]", "simulation: expected a table"),
        ("simulation", "7", "simulation: expected a table"),
    ],
)
def test_the_root_says_what_it_says_in_the_right_type_or_not_at_all(
    tmp_path: Path, name: str, value: Any, says: str
) -> None:
    path = _spoilt(tmp_path, "/", name, value)
    with pytest.raises(UsageError) as caught:
        open_recording(path)
    assert f"{path}: its description is damaged ({says}" in str(caught.value)


@pytest.mark.parametrize("text", ["[" * 9999, "9" * 9999, "{", ""])
def test_json_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(UsageError, match=r"made\.h5: extra"):
        open_recording(_spoilt(tmp_path, "/", "extra", text))


def test_what_stands_beside_the_known_names_is_kept(tmp_path: Path) -> None:
    extra = {"channel_units": {"gyro_v": "V"}, "of_somebody": [1, {"a": None}]}
    with open_recording(_spoilt(tmp_path, "/", "extra", json.dumps(extra))) as recording:
        assert recording.meta.extra == extra


def test_a_step_that_does_not_say_whether_it_is_whole_is_not_taken_for_whole(tmp_path: Path) -> None:
    with h5py.File(made.recording(tmp_path, 1), "r+") as file:
        del file["steps/0001"].attrs["whole"]
        with pytest.raises(ValueError, match="whole is not there"):
            read_info(file["steps/0001"])


def test_a_set_point_may_be_unknown(tmp_path: Path) -> None:
    with open_recording(_spoilt(tmp_path, "steps/0001", "chamber_setpoint_c", math.nan)) as recording:
        assert math.isnan(recording.infos[0].chamber_setpoint_c)
