"""HDF5 files that are damaged where only the library in C sees it."""

from __future__ import annotations

import shutil
import struct
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest

from benchctl.recordings import hdf5_guard
from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.hdf5_files import open_ours
from benchctl.recordings.reader import open_recording
from benchctl.recordings.recover import recover
from benchctl.recordings.verify import verify
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made

needs_limits = pytest.mark.skipif(sys.platform == "win32", reason="a child's memory and time cannot be limited there")


def _text_that_never_ends(content: bytearray) -> None:
    """A heap of texts with an object of 0 bytes: HDF5 2.0.0 stays there for ever."""
    struct.pack_into("<H6xQ", content, content.index(b"GCOL\x01\0\0\0") + 16, 0, 0)


def _names_that_never_end(content: bytearray) -> None:
    """Free room among a group's names that names itself as the next: HDF5 2.0.0 takes memory until there is none."""
    free, address = struct.unpack_from("<QQ", content, content.index(b"HEAP\0\0\0\0") + 16)
    struct.pack_into("<QQ", content, address + free, free, 0)


@needs_limits
@pytest.mark.parametrize(
    ("damage", "libver"), [(_text_that_never_ends, "v108"), (_names_that_never_end, "earliest")], ids=["time", "memory"]
)
def test_a_file_that_keeps_hdf5_busy_for_ever_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damage: Callable[[bytearray], None], libver: str
) -> None:
    if damage is _text_that_never_ends:
        monkeypatch.setattr(hdf5_guard, "_LEAST_S", 1.0)
    path = tmp_path / "a.h5"
    with h5py.File(path, "w", libver=(libver, "v110")) as file:
        file.attrs["format"] = "benchctl-recording/1"
        for name in ("one", "two", "three"):
            file.create_group(f"steps/{name}")
        del file["steps/two"]
    content = bytearray(path.read_bytes())
    damage(content)
    path.write_bytes(content)
    with pytest.raises(UsageError, match=r"a\.h5': cannot be opened: HDF5 crashes on it, or takes more than") as caught:
        open_recording(path)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(sys.platform == "win32", reason="no alarm ends a child there")
def test_of_a_damaged_step_that_nobody_writes_any_more_no_writer_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hdf5_guard, "_WAITS_S", 2)
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running"))
    step = writer.begin_step(made.info(1), made.STREAMED)
    step.append(made.streamed(0.0, 10))
    writer.release()
    content = bytearray(step.path.read_bytes())
    content[20] ^= 0xFF  # of the superblock, whose checksum HDF5 expects a writer to mend
    step.path.write_bytes(content)
    with pytest.raises(UsageError, match=r"cannot be opened: HDF5 crashes on it, or takes more than"):
        open_ours(step.path)
    assert [file.name for file in recover(tmp_path / "c").unreadable] == [step.path.name]


@pytest.mark.parametrize("read", [open_recording, verify])
def test_a_file_on_which_hdf5_crashes_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read: Callable[[Path], object]
) -> None:
    (tmp_path / "h5py.py").write_text("import os\nos.abort()\n")
    monkeypatch.syspath_prepend(tmp_path)  # what the child imports
    path = made.recording(tmp_path, 1)
    copy = shutil.copy(path, tmp_path / "copy.h5")
    with pytest.raises(UsageError, match="HDF5 crashes on it"):
        read(Path(copy))


def test_a_child_opens_a_file_once_and_none_of_our_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[str] = []

    def watched(module: str, arguments: list[str], limit_s: float, **further: object) -> object:
        tried.append(Path(arguments[0]).name)
        return run_limited(module, arguments, limit_s, **further)

    run_limited = hdf5_guard.run_limited
    monkeypatch.setattr(hdf5_guard, "run_limited", watched)
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running"))
    step = writer.begin_step(made.info(1), made.STREAMED)
    step.append(made.streamed(0.0, 10))
    step.close(made.info(1))
    writer.begin_step(made.info(2), made.STREAMED).flush()
    path = made.recording(tmp_path, 1)
    for ours in (tmp_path / "c", path):
        open_recording(ours).close()
        verify(ours)
    open_recording(writer.finish("complete")).close()
    assert tried == []
    copy = Path(shutil.copyfile(path, tmp_path / "copy.h5"))
    for _ in range(2):
        open_recording(copy).close()
        assert verify(copy) == []
    assert tried == ["copy.h5"]
    with h5py.File(copy, "r+") as file:
        file.attrs["status"] = "simulated"
    open_recording(copy).close()
    assert tried == ["copy.h5", "copy.h5"]


def test_what_this_process_has_in_memory_does_not_count_for_the_child(tmp_path: Path) -> None:
    path = tmp_path / "made.h5"
    with h5py.File(path, "w") as file:
        file["a"] = [1.0]
    held = bytearray(700 << 20)
    held[:: 1 << 12] = b"x" * len(held[:: 1 << 12])  # every page is in use
    hdf5_guard.require_harmless(path)
