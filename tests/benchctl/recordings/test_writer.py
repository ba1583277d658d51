from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.model import Step
from benchctl.recordings.reader import open_recording
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made

ANY_FLOAT = hnp.arrays(np.float64, st.integers(0, 50), elements=st.floats(allow_nan=False, width=64))


def test_what_is_written_comes_back(tmp_path: Path) -> None:
    told = made.meta(simulation={"k_T": [1e-4], "T0_c": 23.0}, extra={"csv_decimals": {"gyro_v": 6}})
    path = tmp_path / "a.h5"
    write_recording(path, told, made.steps(3))
    with open_recording(path) as recording:
        assert recording.meta == told
        assert [info.index for info in recording.infos] == [1, 2, 3]
        for written, read in zip(made.steps(3), recording.steps(), strict=True):
            assert made.same(written, read)
            assert read.info == replace(written.info, samples=200, digest=read.info.digest)


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(values=ANY_FLOAT)
def test_every_float_comes_back_bit_by_bit(values: np.ndarray, tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    written = Step(made.info(1), {"time_s": np.arange(float(len(values))), "gyro_v": values})
    write_recording(path, made.meta(), [written])
    with open_recording(path) as recording:
        assert made.same(recording.step(1), written)


def test_a_finished_file_takes_no_more_of_the_disk_than_what_it_holds(tmp_path: Path) -> None:
    nothing = {name: np.zeros(0) for name in made.STREAMED}
    write_recording(tmp_path / "a.h5", made.meta(), [Step(made.info(1), nothing)])
    campaign = CampaignWriter(tmp_path / "c", made.meta())
    campaign.begin_step(made.info(1), made.STREAMED).close(made.info(1))
    files = [tmp_path / "a.h5", *(tmp_path / "c").rglob("*.h5")]
    assert len(files) == 3
    assert max(file.stat().st_size for file in files) < 200_000
    assert campaign.finish("complete").stat().st_size < 200_000


def test_steps_are_read_in_the_order_of_their_index_however_they_were_written(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    write_recording(path, made.meta(), [made.step(2), made.step(1)])
    with open_recording(path) as recording:
        assert [step.info.index for step in recording.steps()] == [1, 2]


def test_what_is_not_known_is_absent_from_the_file(tmp_path: Path) -> None:
    with h5py.File(made.recording(tmp_path)) as file:
        attributes = file["steps/0001"].attrs
        assert "amplitude_dps" not in attributes
        assert attributes["rate_dps"] == 10.0


def test_a_channel_without_a_name_of_ours_keeps_its_unit(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    channels = {"time_s": np.arange(3.0), "supply_a": np.ones(3), "odd": np.ones(3)}
    write_recording(path, made.meta(extra={"channel_units": {"supply_a": "A"}}), [Step(made.info(1), channels)])
    with h5py.File(path) as file:
        assert file["steps/0001/supply_a"].attrs["units"] == "A"
        assert "units" not in file["steps/0001/odd"].attrs


def test_xarray_opens_a_step_without_this_package(tmp_path: Path) -> None:
    data = xarray.open_dataset(made.recording(tmp_path), engine="h5netcdf", group="steps/0002")
    with data:
        assert data["gyro_v"].dims == ("time_s",)
        assert data["poll_chamber_temp_c"].dims == ("poll_time_s",)
        assert data["gyro_v"].attrs["units"] == "V"
        assert data.attrs["kind"] == "constant_rate"
        assert np.array_equal(data["gyro_v"].values, made.step(2)["gyro_v"])


def test_xarray_opens_a_step_in_which_a_channel_is_empty(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    empty = {name: np.empty(0) for name in made.POLLED}
    write_recording(path, made.meta(), [Step(made.info(1), {**made.streamed(0.0, 5), **empty})])
    with xarray.open_dataset(path, engine="h5netcdf", group="steps/0001") as data:
        assert data.sizes == {"time_s": 5, "poll_time_s": 0}


def test_the_file_is_plain_hdf5_of_numbers_and_text(tmp_path: Path) -> None:
    kinds = set()

    def look(_: str, item: h5py.Group | h5py.Dataset) -> None:
        if isinstance(item, h5py.Dataset):
            kinds.add(item.dtype.str)
        for name in item.attrs:
            if name not in ("DIMENSION_LIST", "REFERENCE_LIST"):
                kinds.add(type(item.attrs[name]).__name__)

    with h5py.File(made.recording(tmp_path)) as file:
        file.visititems(look)
    assert kinds == {"<f8", "str", "float64", "int64", "bytes_"}


def _no_axis() -> Step:
    return Step(made.info(7), {"gyro_v": np.ones(3)})


def _unequal() -> Step:
    return Step(made.info(7), {"time_s": np.arange(3.0), "gyro_v": np.ones(4)})


def _two_dimensional() -> Step:
    return Step(made.info(7), {"time_s": np.ones((3, 1))})


def _odd_name() -> Step:
    return Step(made.info(7), {"time_s": np.arange(3.0), "a/b": np.ones(3)})


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        (_no_axis(), "gyro_v lies on time_s, which is not among the channels"),
        (_unequal(), "gyro_v has 4 samples, expected as many as its axis time_s, 3"),
        (_two_dimensional(), r"shape \(n,\), it is float64 of shape \(3, 1\)"),
        (_odd_name(), "'a/b' must be named with letters"),
        (made.step(1), "two steps have the index 1"),
    ],
)
def test_steps_that_do_not_fit_leave_nothing_behind(tmp_path: Path, bad: Step, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        write_recording(tmp_path / "a.h5", made.meta(), [made.step(1), bad])
    assert list(tmp_path.iterdir()) == []


def test_an_error_while_steps_are_made_leaves_the_older_file_as_it_was(tmp_path: Path) -> None:
    path = made.recording(tmp_path)
    before = path.read_bytes()

    def failing() -> object:
        yield made.step(1)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_recording(path, made.meta(), failing())  # type: ignore[arg-type]
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"nowhere/a\.h5: cannot be written: no such file or directory"):
        write_recording(tmp_path / "nowhere" / "a.h5", made.meta(), [])
