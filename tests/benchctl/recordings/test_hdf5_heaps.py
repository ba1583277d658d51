"""Heaps of texts that HDF5 would walk for ever."""

from __future__ import annotations

import struct
import time
from pathlib import Path

import h5py
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchctl.recordings.hdf5_heaps import check_heaps
from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import verify
from instruments.errors import UsageError
from tests.benchctl.recordings import made
from tests.slowness import slowness

_HEAD_BYTES = 16


def _heap_of(content: bytes) -> int:
    place = content.find(b"GCOL\x01\0\0\0")
    assert place > 0
    return place


@pytest.mark.parametrize(("index", "size"), [(0, 0), (1, 2**64 - 8), (1, 2**64 - 16), (1, 1 << 40), (0, 1 << 63)])
def test_an_object_that_leads_nowhere_is_refused_in_time(tmp_path: Path, index: int, size: int) -> None:
    path = made.recording(tmp_path, 1)
    content = bytearray(path.read_bytes())
    struct.pack_into("<H6xQ", content, _heap_of(content) + _HEAD_BYTES, index, size)
    path.write_bytes(content)
    begun = time.process_time()
    for read in (open_recording, verify):
        with pytest.raises(UsageError, match=r"made\.h5: is damaged: its texts are damaged at byte \d+"):
            read(path)
    assert time.process_time() - begun < 1.0 * slowness()


def test_a_heap_that_reaches_beyond_the_file_is_refused(tmp_path: Path) -> None:
    path = made.recording(tmp_path, 1)
    content = bytearray(path.read_bytes())
    struct.pack_into("<Q", content, _heap_of(content) + 8, 1 << 30)
    path.write_bytes(content)
    with pytest.raises(UsageError, match="are cut short, or damaged"):
        open_recording(path)


def test_the_heaps_of_a_sound_recording_are_sound(tmp_path: Path) -> None:
    check_heaps(made.recording(tmp_path, 5))


def _grouped(path: Path, user_bytes: int = 0) -> Path:
    """A file in HDF5's oldest layout, whose groups keep their names in heaps, with room among the names."""
    with h5py.File(path, "w", libver="earliest", userblock_size=user_bytes) as file:
        for name in ("one", "two", "three"):
            file.create_group(f"steps/{name}")
        del file["steps/two"]
    return path


def _names_of(content: bytes, which: int = 0) -> tuple[int, int, int]:
    """Of a heap of names: where it is, its first free piece, and the address of its names."""
    place = -1
    for _ in range(which + 1):
        place = content.index(b"HEAP\0\0\0\0", place + 1)
    _, free, address = struct.unpack_from("<QQQ", content, place + 8)
    return place, free, address


@pytest.mark.parametrize("user_bytes", [0, 512, 2048])
@pytest.mark.parametrize("which", [0, 1])
def test_free_room_that_names_itself_as_the_next_is_refused_in_time(
    tmp_path: Path, which: int, user_bytes: int
) -> None:
    path = _grouped(tmp_path / "a.h5", user_bytes)
    check_heaps(path)
    content = bytearray(path.read_bytes())
    _, free, address = _names_of(content, which)
    struct.pack_into("<QQ", content, user_bytes + address + free, free, 0)
    path.write_bytes(content)
    begun = time.process_time()
    for read in (open_recording, verify):
        with pytest.raises(UsageError, match=r"a\.h5: is damaged: its names are damaged at byte \d+"):
            read(path)
    assert time.process_time() - begun < 1.0 * slowness()


@pytest.mark.parametrize("filled_with", [b"\0", b"\xff", b"a"])
def test_a_heap_of_names_that_is_no_longer_used_may_have_anything_in_its_place(
    tmp_path: Path, filled_with: bytes
) -> None:
    path = _grouped(tmp_path / "a.h5")
    content = bytearray(path.read_bytes())
    place, _, address = _names_of(content)
    size = struct.unpack_from("<Q", content, place + 8)[0]
    content[address : address + size] = filled_with * size
    path.write_bytes(content)
    check_heaps(path)


def test_more_heaps_than_any_recording_has_are_refused_in_time(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    path.write_bytes(b"HEAP\0\0\0\0" * (1 << 20))
    begun = time.process_time()
    with pytest.raises(ValueError, match="more free room among them"):
        check_heaps(path)
    assert time.process_time() - begun < 3.0 * slowness()


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=200))
def test_any_heap_is_walked_or_refused(tmp_path: Path, rest: bytes) -> None:
    path = tmp_path / "a.h5"
    for signature, says in ((b"GCOL\x01\0\0\0", "its texts"), (b"HEAP\0\0\0\0", "its names")):
        path.write_bytes(signature + rest)
        try:
            check_heaps(path)
        except ValueError as err:
            assert says in str(err)  # noqa: PT017 - either is an answer
