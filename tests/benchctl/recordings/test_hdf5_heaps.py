"""Heaps of texts that HDF5 would walk for ever."""

from __future__ import annotations

import struct
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchctl.recordings.hdf5_heaps import check_heaps
from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import verify
from instruments.errors import UsageError
from tests.benchctl.recordings import made

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
    assert time.process_time() - begun < 1.0


def test_a_heap_that_reaches_beyond_the_file_is_refused(tmp_path: Path) -> None:
    path = made.recording(tmp_path, 1)
    content = bytearray(path.read_bytes())
    struct.pack_into("<Q", content, _heap_of(content) + 8, 1 << 30)
    path.write_bytes(content)
    with pytest.raises(UsageError, match="are cut short, or damaged"):
        open_recording(path)


def test_the_heaps_of_a_sound_recording_are_sound(tmp_path: Path) -> None:
    check_heaps(made.recording(tmp_path, 5))


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=200))
def test_any_heap_is_walked_or_refused(tmp_path: Path, rest: bytes) -> None:
    path = tmp_path / "a.h5"
    path.write_bytes(b"GCOL\x01\0\0\0" + rest)
    try:
        check_heaps(path)
    except ValueError as err:
        assert "its texts" in str(err)  # noqa: PT017 - either is an answer
