from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.protocols import kvh1760 as kvh
from benchctl_instruments.protocols.frames import FrameReader

PUBLISHED = bytes.fromhex("FE81FF55 37A96A6E 38586C1F B75BF862 BF803E78 BB650D28 3B0A37AC 77 3D 0028 4BFA34D8")


def read(data: bytes) -> kvh.KvhFrames:
    (run,) = FrameReader([kvh.FORMAT]).feed(data)
    return kvh.decode_frames(run.rows)


def test_the_published_frame_is_read() -> None:
    frames = read(PUBLISHED)
    assert frames.rotation.tolist() == [list(struct.unpack(">3f", PUBLISHED[4:16]))]
    assert frames.rotation[0, 0] == pytest.approx(2.0196e-5, rel=1e-4)
    assert (frames.status[0], frames.sequence[0], frames.temperature[0]) == (0x77, 61, 40)


def test_a_frame_is_encoded_to_the_last_byte() -> None:
    data = kvh.encode_frames([[1.0, -2.0, 0.5]], -25, first_sequence=130, status=0b101)
    assert data[:32] == bytes.fromhex("FE81FF55 3F800000 C0000000 3F000000" + 24 * "0" + "05 02 FFE7")
    assert len(data) == kvh.FORMAT.length == 36


def test_numbers_go_up_by_one_and_wrap_after_127() -> None:
    data = kvh.encode_frames(np.zeros((4, 3)), [1, 2, 3, 4], first_sequence=126)
    frames = read(data)
    assert frames.sequence.tolist() == [126, 127, 0, 1]
    assert frames.temperature.tolist() == [1, 2, 3, 4]


@settings(deadline=None)
@given(
    st.lists(st.tuples(*[st.floats(width=32, allow_nan=False)] * 3), min_size=1, max_size=20),
    st.integers(0, 127),
    st.integers(-0x8000, 0x7FFF),
    st.integers(0, 255),
)
def test_what_is_encoded_is_read_back(
    rotation: list[tuple[float, float, float]], first: int, temperature: int, status: int
) -> None:
    frames = read(kvh.encode_frames(rotation, temperature, first_sequence=first, status=status))
    assert frames.rotation.tolist() == [list(row) for row in rotation]
    assert set(frames.temperature) == {temperature}
    assert set(frames.status) == {status}
    assert frames.sequence.tolist() == [(first + place) % 128 for place in range(len(rotation))]


def test_a_status_says_which_channels_are_not_valid() -> None:
    assert kvh.status_words(0b111) == ()
    assert kvh.status_words(0b101) == ("gyro Y is not valid",)
    assert kvh.status_words(0b101, channels=0b100) == ()
    assert kvh.status_words(0, channels=0x77)[-1] == "accelerometer Z is not valid"


def test_settings_are_lines_of_name_and_value() -> None:
    assert kvh.encode_setting("dr", 1000) == b"=dr,1000\r\n"
    assert kvh.encode_answer("rotfmt", "rate") == b"ROTFMT,RATE\r\n"


@settings(deadline=None)
@given(st.lists(st.integers(1, 9), min_size=1, max_size=30))
def test_commands_are_heard_in_whatever_pieces_and_case_they_come(sizes: list[int]) -> None:
    said, heard, at = b"=CONFIG,1\r\nrubbish\r\n=TempUnits,C_100\n?DR\n=dr,100\r\n=rstcfg\r\n=dr,1", [], 0
    reader = kvh.CommandReader()
    for size in [*sizes, len(said)]:
        heard += reader.feed(said[at : at + size])
        at += size
    assert [(one.sign, one.name, one.value) for one in heard] == [
        ("=", "config", "1"),
        ("=", "tempunits", "c_100"),
        ("?", "dr", ""),
        ("=", "dr", "100"),
        ("=", "rstcfg", ""),
    ]


def test_an_answer_is_found_between_frames_and_only_when_its_line_is_whole() -> None:
    assert kvh.after_echo(PUBLISHED + b"DR,100\r\n" + PUBLISHED, "dr", 100) == PUBLISHED
    assert kvh.after_echo(PUBLISHED + b"dr,1000\r\n", "dr", 100) is None
    assert kvh.after_echo(b"DR,100", "dr", 100) is None
    assert kvh.after_echo(b"DR,100\r", "dr", 100) == b""


def test_a_stream_begins_behind_the_echo_or_with_the_first_good_frame() -> None:
    assert kvh.after_leaving(b"CONFIG,0\r\n" + PUBLISHED) == PUBLISHED
    assert kvh.after_leaving(b"\xfe\x81junk" + PUBLISHED + PUBLISHED[:9]) == PUBLISHED + PUBLISHED[:9]
    assert kvh.after_leaving(PUBLISHED[:35]) is None
    assert kvh.after_leaving(PUBLISHED[:35] + b"?") is None  # a frame with a wrong CRC
    assert kvh.after_leaving(b"CONFIG,1\r\n") is None


def test_a_refusal_is_found_once_its_line_is_complete() -> None:
    assert kvh.refusal_in(PUBLISHED + b"INVALID,DR,125\r\n") == "INVALID,DR,125"
    assert kvh.refusal_in(b"INVALID,DR,125") == ""
    assert kvh.refusal_in(b"DR,125\r\n") == ""
