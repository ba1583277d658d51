"""A recording with the compensated rate beside what was recorded."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import xarray

from benchctl.calibration.compensated_file import Applied, write_compensated
from benchctl.calibration.compensating import read_compensation
from benchctl.recordings.exporting import export_csv
from benchctl.recordings.model import Step, Unit
from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import verify
from benchctl.recordings.writer import write_recording
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from tests.benchctl.calibration.made_coefficients import written
from tests.benchctl.recordings import made

COMPENSATED = ("compensated_dps", "compensated_valid")


def _streamed(rows: int = 500) -> dict[str, FloatArray]:
    """Outputs from far below to far above what was measured, at 20 °C."""
    return {**made.streamed(0.0, rows), "gyro_v": np.linspace(-9.0, 9.0, rows), "gyro_temp_c": np.full(rows, 20.0)}


def _recording(folder: Path, *steps: Mapping[str, FloatArray], **changes: object) -> Path:
    path = folder / "r.h5"
    write_recording(
        path,
        made.meta(**changes),
        [Step(made.info(i, t_start=0.0), channels) for i, channels in enumerate(steps, start=1)],
    )
    return path


def _apply(path: Path, out: Path, **changes: object) -> Applied:
    compensation = read_compensation(written(path.parent, **changes))
    with open_recording(path) as recording:
        return write_compensated(
            out, recording, compensation, digest=recording.digest, coefficients="coefficients.json"
        )


def test_the_copy_has_everything_of_the_recording_and_the_rate(tmp_path: Path) -> None:
    path = _recording(tmp_path, _streamed(), made.polled(0.0))
    before = path.read_bytes()
    applied = _apply(path, tmp_path / "c.h5")
    assert path.read_bytes() == before
    assert verify(tmp_path / "c.h5") == []
    compensation = read_compensation(tmp_path / "coefficients.json")
    with open_recording(path) as old, open_recording(tmp_path / "c.h5") as new:
        assert new.meta.unit == old.meta.unit
        one, other = old.step(1), new.step(1)
        assert set(other.channels) == {*one.channels, *COMPENSATED}
        assert all(np.array_equal(other[name], one[name]) for name in one.channels)
        rate_dps = compensation.law.rate_dps(one["gyro_v"], one["gyro_temp_c"])
        assert np.array_equal(other["compensated_dps"], rate_dps)
        valid = np.abs(rate_dps) <= 150.0
        assert np.array_equal(other["compensated_valid"], valid.astype(float))
        assert made.same(new.step(2), old.step(2))
        facts = json.loads(new.meta.provenance["compensation"])
        assert facts["digest"] == old.digest
        assert facts["coefficients_sha256"] == compensation.sha256
        assert (facts["law"], facts["delay_s"]) == ("joint", 1.125e-3)
    assert (applied.samples, applied.outside) == (500, int((~valid).sum()))
    assert applied.most_dps == pytest.approx(np.abs(rate_dps).max() - 150.0)
    assert applied.most_c == 0.0


def test_the_channels_tell_any_reader_what_they_are(tmp_path: Path) -> None:
    _apply(_recording(tmp_path, _streamed()), tmp_path / "c.h5")
    with xarray.open_dataset(tmp_path / "c.h5", engine="h5netcdf", group="steps/0001") as data:
        rate = data["compensated_dps"]
        assert rate.dims == ("time_s",)
        assert rate.attrs["units"] == "degree/s"
        assert "the rate belongs to time_s - 0.001125 s" in rate.attrs["comment"]
        assert "from -150 to 150 degree/s and from -40 to 60 degC" in data["compensated_valid"].attrs["comment"]


def test_the_stages_are_applied_where_they_are_asked_for(tmp_path: Path) -> None:
    path = _recording(tmp_path, _streamed())
    compensation = read_compensation(written(tmp_path), "stages")
    with open_recording(path) as recording:
        write_compensated(tmp_path / "c.h5", recording, compensation, digest="d", coefficients="c")
    with open_recording(tmp_path / "c.h5") as new:
        step = new.step(1)
        expected = compensation.law.rate_dps(step["gyro_v"], step["gyro_temp_c"])
        assert np.array_equal(step["compensated_dps"], expected)
        assert "of the stages" in new.meta.extra["channel_comments"]["compensated_dps"]


def test_outputs_that_mean_no_rate_are_marked_and_not_an_error(tmp_path: Path) -> None:
    channels = _streamed(4) | {"gyro_v": np.array([0.0, 100.0, np.nan, 0.0])}
    channels["gyro_temp_c"] = np.array([20.0, 20.0, 20.0, np.nan])
    assert _apply(_recording(tmp_path, channels), tmp_path / "c.h5").outside == 3
    with open_recording(tmp_path / "c.h5") as new:
        step = new.step(1)
    assert np.isnan(step["compensated_dps"]).tolist() == [False, True, True, True]
    assert step["compensated_valid"].tolist() == [1.0, 0.0, 0.0, 0.0]


def test_a_step_without_thermistor_is_kept_as_it_is_and_told(tmp_path: Path) -> None:
    bare = {name: samples for name, samples in _streamed().items() if name != "gyro_temp_c"}
    applied = _apply(_recording(tmp_path, _streamed(), bare), tmp_path / "c.h5")
    assert (applied.samples, applied.without) == (500, (2,))
    with open_recording(tmp_path / "c.h5") as new:
        assert set(new.channels(2)) == set(bare)


def test_a_compensated_recording_can_be_exported(tmp_path: Path) -> None:
    _apply(_recording(tmp_path, _streamed()), tmp_path / "c.h5")
    with open_recording(tmp_path / "c.h5") as new:
        export_csv(new, tmp_path / "csv")
    assert json.loads((tmp_path / "csv" / "recording.json").read_text())["units"]["compensated_dps"] == "degree/s"


def test_nothing_to_compensate_is_refused(tmp_path: Path) -> None:
    points = {f"point_{name}": np.zeros(3) for name in ("rate_dps", "mean_v")} | {"time_s": np.arange(3.0)}
    for channels in (points, made.polled(0.0)):
        with pytest.raises(UsageError, match="no step has gyro_v and gyro_temp_c"):
            _apply(_recording(tmp_path, channels), tmp_path / "c.h5")
    assert not (tmp_path / "c.h5").exists()


def test_coefficients_of_another_unit_are_refused_but_not_those_of_none(tmp_path: Path) -> None:
    path = _recording(tmp_path, _streamed())
    with pytest.raises(UsageError, match="is of unit VG-7, the coefficients are of unit VG-8"):
        _apply(path, tmp_path / "c.h5", unit="VG-8")
    with pytest.raises(UsageError, match="its output is in V, that of the coefficients in deg/s"):
        _apply(path, tmp_path / "c.h5", output_unit="deg/s")
    assert not (tmp_path / "c.h5").exists()
    assert _apply(path, tmp_path / "c.h5", unit=None).samples == 500
    nameless = _recording(tmp_path, _streamed(), unit=Unit(serial="", range_dps=150.0))
    assert _apply(nameless, tmp_path / "d.h5", unit="VG-8").samples == 500


def test_a_recording_is_not_compensated_twice(tmp_path: Path) -> None:
    _apply(_recording(tmp_path, _streamed()), tmp_path / "c.h5")
    with pytest.raises(UsageError, match="has compensated_dps already"):
        _apply(tmp_path / "c.h5", tmp_path / "d.h5")
    assert not (tmp_path / "d.h5").exists()
