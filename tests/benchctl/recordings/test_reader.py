from __future__ import annotations

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from benchctl.recordings.model import Step
from benchctl.recordings.reader import open_recording
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made
from tests.shared import SHARED, needs_shared


def test_steps_are_chosen_by_kind_and_role(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    kinds = [made.step(1, kind="sine"), made.step(2, kind="sine", role="verify"), made.step(3, role="verify")]
    write_recording(path, made.meta(), kinds)
    with open_recording(path) as recording:
        assert [step.info.index for step in recording.steps(kinds={"sine"})] == [1, 2]
        assert [step.info.index for step in recording.steps(roles={"verify"})] == [2, 3]
        assert [step.info.index for step in recording.steps({"sine"}, {"verify"})] == [2]


def test_one_step_or_one_channel_of_it_can_be_read(tmp_path: Path) -> None:
    with open_recording(made.recording(tmp_path)) as recording:
        assert made.same(recording.step(2), made.step(2))
        assert set(recording.channels(2)) == {*made.STREAMED, *made.POLLED}
        assert list(recording.step(2, ["gyro_v"]).channels) == ["gyro_v"]
        with pytest.raises(UsageError, match=r"there is no step 8; it has the steps \[1, 2, 3\]"):
            recording.step(8)


def test_a_soak_has_no_scans(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    write_recording(path, made.meta(), [Step(made.info(1, kind="soak", role="none"), made.polled(0.0))])
    with open_recording(path) as recording:
        assert recording.infos[0].samples == 0
        assert set(recording.step(1).channels) == set(made.POLLED)


def test_a_set_point_that_is_not_known_comes_back_as_such(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    write_recording(path, made.meta(), [made.step(1, chamber_setpoint_c=float("nan"))])
    with open_recording(path) as recording:
        assert np.isnan(recording.infos[0].chamber_setpoint_c)


def _fails(path: Path, says: str) -> None:
    with pytest.raises(UsageError, match=says) as caught:
        open_recording(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    _fails(tmp_path / "no.h5", "there is no such file")


def test_an_empty_folder_is_no_recording(tmp_path: Path) -> None:
    _fails(tmp_path, "is no recording: expected recording.h5")


@pytest.mark.parametrize("content", [b"", b"time_s,gyro_v\n0,1\n", b"PK\x03\x04" * 1000])
def test_a_file_that_is_not_hdf5_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.h5"
    path.write_bytes(content)
    _fails(path, rf"is not an HDF5 file \({len(content)} bytes\)")


def test_hdf5_of_somebody_else_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["data"] = np.arange(3.0)
    _fails(path, "is HDF5, but no recording of benchctl")


def test_a_newer_format_asks_for_an_update(tmp_path: Path) -> None:
    path = made.recording(tmp_path)
    with made.changed(path) as file:
        file.attrs["format"] = "benchctl-recording/2"
    _fails(path, "has the format 'benchctl-recording/2', this benchctl reads 'benchctl-recording/1'; update")


@pytest.mark.parametrize(("where", "name"), [("/", "status"), ("/", "unit_serial"), ("steps/0002", "kind")])
def test_a_description_with_a_hole_is_named(tmp_path: Path, where: str, name: str) -> None:
    path = made.recording(tmp_path)
    with made.changed(path) as file:
        del file[where].attrs[name]
    _fails(path, "its description is damaged")


def test_a_step_under_a_name_that_is_not_its_own_is_named(tmp_path: Path) -> None:
    path = made.recording(tmp_path)
    with made.changed(path) as file:
        file.move("steps/0002", "steps/0009")
    _fails(path, "the group /steps/0009 states that its index is 2")


def test_a_file_without_its_steps_is_named(tmp_path: Path) -> None:
    path = made.recording(tmp_path)
    with made.changed(path) as file:
        del file["steps"]
    _fails(path, "is damaged: its steps are gone")


def test_what_others_put_beside_the_channels_is_left_alone(tmp_path: Path) -> None:
    path = made.recording(tmp_path)
    with made.changed(path) as file:
        file["steps/0002"].create_group("notes").attrs["by"] = "somebody"
    with open_recording(path) as recording:
        assert made.same(recording.step(2), made.step(2))


@pytest.mark.parametrize("share", [0.05, 0.5, 0.95, 0.9999])
def test_a_file_that_was_cut_short_says_how_much_is_missing(tmp_path: Path, share: float) -> None:
    path = made.recording(tmp_path)
    content = path.read_bytes()
    kept = int(len(content) * share)
    path.write_bytes(content[:kept])
    _fails(path, f"was cut short: {kept} of {len(content)} bytes are there")


def test_a_damaged_block_is_one_line_when_its_step_is_read(tmp_path: Path) -> None:
    path = made.recording(tmp_path)
    with h5py.File(path) as file:
        chunk = file["steps/0003/gyro_v"].id.get_chunk_info(0)
    content = bytearray(path.read_bytes())
    content[chunk.byte_offset : chunk.byte_offset + 8] = b"\xff" * 8
    path.write_bytes(content)
    with open_recording(path) as recording:
        assert made.same(recording.step(2), made.step(2))
        with pytest.raises(UsageError, match=r"made.h5: step 3 'rate \+3' cannot be read"):
            recording.step(3)


def test_a_file_that_may_not_be_read_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = made.recording(tmp_path)

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(h5py, "File", refuse)
    _fails(path, "may not be read by you")


@needs_shared("recordings/examples/single")
def test_an_open_recording_is_opened_like_one_of_ours(tmp_path: Path) -> None:
    folder = tmp_path / "single"
    shutil.copytree(SHARED / "recordings/examples/single", folder)
    with open_recording(folder) as recording:
        assert recording.meta.status == "imported"
        assert recording.digest == ""
        step = recording.step(recording.infos[0].index)
        assert step["gyro_v"].size == step.info.samples > 0
