"""Text files from strangers: gzip that blows up, a gigabyte in a line, and what is no file."""

from __future__ import annotations

import gzip
import json
import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchctl.recordings.text_file import read_bytes, read_json_text, sources_json
from benchctl_instruments.errors import UsageError


def _refusal(path: Path) -> str:
    with pytest.raises(UsageError) as caught:
        read_bytes(path)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    return message


def test_a_gzip_bomb_is_left_long_before_it_has_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(b"0,0\n" * (5 << 20), mtime=0))
    assert "bytes of gzip become more than 16777216, which no table of numbers does" in _refusal(path)


def test_a_bomb_that_is_cut_short_is_left_as_well(tmp_path: Path) -> None:
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(bytes(20 << 20), mtime=0)[:-1000])
    assert "bytes of gzip become more than" in _refusal(path)


def test_a_table_that_packs_well_is_read_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "log.csv.gz"
    text = b"".join(b"%.3f,0.000000,23.00\n" % (0.001 * k) for k in range(100_000))
    path.write_bytes(gzip.compress(text, mtime=0))
    assert read_bytes(path) == text


def test_a_line_that_never_ends_is_named(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(b"time_s,gyro_v\n0,1\n" + b"1," * (1 << 20))
    assert "log.csv, line 3: is longer than 1048576 bytes" in _refusal(path)


def test_a_line_of_just_the_limit_is_read(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(b"x" * ((1 << 20) - 1) + b"\ny\n")
    assert read_bytes(path) == path.read_bytes()


def test_a_pipe_or_a_device_in_place_of_a_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "samples.csv")
    assert "it is no file" in _refusal(tmp_path / "samples.csv")
    (tmp_path / "link.csv").symlink_to("/dev/zero")
    assert "it is no file" in _refusal(tmp_path / "link.csv")


def test_a_file_that_claims_terabytes_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    with path.open("wb") as file:
        file.truncate(1 << 42)  # a hole: it takes no room
    assert "its text needs 2.2e+04 GB of memory" in _refusal(path)


def test_a_description_of_gigabytes_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "recording.json"
    with path.open("wb") as file:
        file.truncate(1 << 34)
    with pytest.raises(UsageError, match="has 17179869184 bytes, expected at most 16777216"):
        read_json_text(path)


@settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(st.binary(max_size=200) | st.binary(max_size=200).map(lambda data: b"\x1f\x8b\x08\x00" + data))
def test_any_bytes_are_lines_or_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(data)
    try:
        text = read_bytes(path)
    except UsageError:
        return
    assert text.endswith(b"\n")
    assert b"\r" not in text


def test_the_digests_of_sources_are_those_of_their_bytes(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(b"abc")
    [told] = json.loads(sources_json([path])).values()
    assert told == {"bytes": 3, "sha256": "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"}
