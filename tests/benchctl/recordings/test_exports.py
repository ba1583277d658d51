from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import xarray
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import loadmat

from benchctl.recordings.exporting import EXPORTERS, export_csv, export_mat, export_netcdf
from benchctl.recordings.model import Step
from benchctl.recordings.reader import open_recording
from benchctl.recordings.text_file import csv_rows
from benchctl.recordings.verify import summarise
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made


@given(st.lists(st.floats(allow_nan=False, width=64), min_size=1))
def test_printed_numbers_give_back_the_same_floats(values: list[float]) -> None:
    text = b"".join(csv_rows([np.array(values)], ["a"]))
    assert np.array_equal(np.array([float(line) for line in text.splitlines()]), np.array(values))


def test_many_rows_are_printed_in_order_with_the_decimals_asked_for() -> None:
    count = 20_001
    text = b"".join(csv_rows([np.arange(count) / 8, np.ones(count)], ["a", "b"], {"a": 3}))
    lines = text.decode().splitlines()
    assert len(lines) == count
    assert lines[:2] == ["0.000,1.0", "0.125,1.0"]
    assert lines[-1] == "2500.000,1.0"


def test_csv_has_a_file_a_step_and_axis_and_says_the_rest_in_json(tmp_path: Path) -> None:
    with open_recording(made.recording(tmp_path, count=2)) as recording:
        export_csv(recording, tmp_path / "csv")
    described = json.loads((tmp_path / "csv" / "recording.json").read_text())
    assert described["units"]["gyro_v"] == "V"
    assert described["provenance"]["operator"] == "Ö. Ångström"
    assert described["steps"][1]["files"] == ["0002_rate_+2.csv", "0002_rate_+2_polled.csv"]
    with (tmp_path / "csv" / "0002_rate_+2.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == list(made.STREAMED)
    assert [float(row["gyro_v"]) for row in rows] == made.step(2)["gyro_v"].tolist()


def test_csv_of_a_soak_has_polls_only_and_unknown_numbers_are_null(tmp_path: Path) -> None:
    soak = Step(made.info(1, kind="soak", chamber_setpoint_c=float("nan")), made.polled(0.0))
    write_recording(tmp_path / "a.h5", made.meta(), [soak])
    with open_recording(tmp_path / "a.h5") as recording:
        export_csv(recording, tmp_path / "csv")
    assert sorted(file.name for file in (tmp_path / "csv").iterdir()) == ["0001_rate_+1_polled.csv", "recording.json"]
    assert json.loads((tmp_path / "csv" / "recording.json").read_text())["steps"][0]["chamber_setpoint_c"] is None


def test_matlab_gets_a_struct_a_step(tmp_path: Path) -> None:
    with open_recording(made.recording(tmp_path, count=2)) as recording:
        export_mat(recording, tmp_path / "a.mat")
    loaded = loadmat(tmp_path / "a.mat", squeeze_me=False, struct_as_record=False)
    step = loaded["step_0002"][0, 0]
    assert step.gyro_v.shape == (200, 1)
    assert np.array_equal(step.gyro_v[:, 0], made.step(2)["gyro_v"])
    assert step.kind[0] == "constant_rate"
    assert step.rate_dps[0, 0] == 20.0
    assert not hasattr(step, "amplitude_dps")
    assert loaded["recording"][0, 0].units[0, 0].gyro_v[0] == "V"
    assert loaded["recording"][0, 0].provenance[0, 0].operator[0] == "Ö. Ångström"


def test_a_recording_without_provenance_makes_a_mat_file_too(tmp_path: Path) -> None:
    with open_recording(made.recording(tmp_path, count=0, provenance={})) as recording:
        export_mat(recording, tmp_path / "a.mat")
    assert "recording" in loadmat(tmp_path / "a.mat")


def test_netcdf_opens_in_xarray_with_a_group_a_step_and_the_same_digest(tmp_path: Path) -> None:
    with open_recording(made.recording(tmp_path, count=2)) as recording:
        export_netcdf(recording, tmp_path / "a.nc")
        digest = recording.digest
    with xarray.open_dataset(tmp_path / "a.nc", engine="h5netcdf", group="steps/0002") as data:
        assert np.array_equal(data["gyro_v"].values, made.step(2)["gyro_v"])
    with xarray.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as root:
        assert root.attrs["digest"] == digest
        assert root.attrs["unit_serial"] == "VG-7"


@pytest.mark.parametrize("to", ["csv", "mat", "netcdf", "open"])
def test_every_format_refuses_a_place_that_is_not_there_in_one_line(tmp_path: Path, to: str) -> None:
    with open_recording(made.recording(tmp_path)) as recording, pytest.raises(UsageError, match="cannot be written"):
        EXPORTERS[to](recording, tmp_path / "nowhere" / "x")
    assert not (tmp_path / "nowhere").exists()


def test_a_summary_says_what_is_in_a_recording(tmp_path: Path) -> None:
    path = made.recording(tmp_path)
    with open_recording(path) as recording:
        summary = summarise(recording)
    assert summary["status"] == "complete"
    assert [step["samples"] for step in summary["steps"]] == [200, 200, 200]
    assert {"name": "gyro_v", "unit": "V", "rate_hz": 100.0} in summary["channels"]
    assert {"name": "poll_chamber_temp_c", "unit": "degC", "rate_hz": None} in summary["channels"]
    assert summary["digest_ok"] is True
    assert json.dumps(summary)


def test_a_summary_names_what_changed(tmp_path: Path) -> None:
    path = made.recording(tmp_path)
    with open_recording(path) as recording:
        content = bytearray(path.read_bytes())
        at = content.find(b"two_stage")
        content[at : at + 9] = b"too_stage"
        path.write_bytes(content)
    with open_recording(path) as recording:
        summary = summarise(recording)
    assert summary["digest_ok"] is False
    assert summary["problems"] == ['recording: attribute provenance_procedure changed from "two_stage" to "too_stage"']
