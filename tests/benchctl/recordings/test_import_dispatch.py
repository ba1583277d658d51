"""What an import takes for what, and that it writes whole files or none."""

from __future__ import annotations

from pathlib import Path

import h5py
import pytest

from benchctl.recordings.importing import import_recording, read_foreign
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings.open_folder import write_open


def test_an_open_recording_becomes_a_file_of_ours(tmp_path: Path) -> None:
    done = import_recording(write_open(tmp_path / "bench"), None, tmp_path / "bench.h5")
    assert (done.steps, done.samples) == (3, 40)
    with h5py.File(tmp_path / "bench.h5") as file:
        assert file.attrs["status"] == "imported"
        assert [group.attrs["name"] for group in file["steps"].values()] == ["rest", "turn", "rows from 31"]
        assert file["steps/0002/gyro_v"][:].tolist() == pytest.approx([0.001 * k for k in range(10, 30)])


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("log.csv", "t,angle,out\n1,2,3\n", "name a map file"),
        ("log.mat", "MATLAB", "name a map file"),
        ("log.bin", "?", "name a map file"),
        ("log.h5", "x", "every command takes those of benchctl as they are"),
    ],
)
def test_what_needs_a_map_or_no_import_is_told_so(tmp_path: Path, name: str, content: str, says: str) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(UsageError, match=rf"{name}.*{says}"):
        read_foreign(tmp_path / name)


def test_a_source_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"nowhere: there is no such file or folder"):
        read_foreign(tmp_path / "nowhere")


def test_a_folder_that_is_no_recording_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"expected a folder with recording\.json"):
        read_foreign(tmp_path)


def test_a_disk_that_refuses_leaves_nothing_behind(tmp_path: Path) -> None:
    folder = write_open(tmp_path / "bench")
    with pytest.raises(UsageError, match="cannot be written"):
        import_recording(folder, None, tmp_path / "no folder" / "out.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["bench"]
