from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from instruments.errors import InstrumentError, UsageError
from instruments.protocols.lines import MAX_LINE, LineCutter, encode_line

TEXTS = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), min_size=1).map(str.strip).filter(bool)


def test_lines_end_with_lf_and_a_cr_before_it_does_not_count() -> None:
    assert LineCutter().feed(b"OK:TEMP\r\n23.0, 85.0\n") == ["OK:TEMP", "23.0, 85.0"]


def test_a_line_may_end_otherwise() -> None:
    assert LineCutter(b"\r").feed(b"1.5\r2.5\r\n") == ["1.5", "2.5"]
    assert LineCutter(b",EndOfAPI").feed(b"0,1,EndOfAPI") == ["0,1"]


def test_empty_lines_are_left_out() -> None:
    assert LineCutter().feed(b"\r\n\n  \r\nOK\r\n") == ["OK"]


def test_noise_around_a_line_is_dropped_and_inside_it_is_shown() -> None:
    assert LineCutter().feed(b"\x00\xff\x00OK\x00\r\n2\xfe3.0\r\n") == ["OK", r"2\xfe3.0"]


@settings(deadline=None)
@given(st.lists(TEXTS, max_size=5), st.data())
def test_however_the_stream_is_cut_the_lines_are_the_same(texts: list[str], data: st.DataObject) -> None:
    stream = b"".join(map(encode_line, texts))
    cuts = sorted(data.draw(st.sets(st.integers(0, len(stream)))))
    cutter = LineCutter()
    lines: list[str] = []
    for low, high in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        lines += cutter.feed(stream[low:high])
    assert lines == texts


@settings(deadline=None)
@given(st.lists(st.binary(max_size=200) | st.binary(max_size=20).map(lambda few: few * 300), max_size=8))
def test_no_bytes_break_it_and_its_memory_is_bounded(pieces: list[bytes]) -> None:
    cutter = LineCutter()
    for piece in pieces:
        try:
            lines = cutter.feed(piece)
        except InstrumentError:
            lines = []
        assert all(line == line.strip() and line for line in lines)
        assert len(cutter._pending) <= MAX_LINE


@pytest.mark.parametrize("end", [b"", b"\n"])
def test_a_line_that_is_too_long_is_an_error_and_forgotten(end: bytes) -> None:
    cutter = LineCutter()
    with pytest.raises(InstrumentError, match=rf"more than {MAX_LINE} bytes without an end of line, beginning b'xxx"):
        cutter.feed(b"x" * (MAX_LINE + 1) + end)
    assert cutter.feed(b"fresh\n") == ["fresh"]


def test_a_line_of_the_greatest_length_is_taken() -> None:
    assert LineCutter().feed(b"x" * MAX_LINE + b"\n") == ["x" * MAX_LINE]


def test_a_line_is_sent_with_the_end_that_was_asked_for() -> None:
    assert encode_line("1MV+", b"\r") == b"1MV+\r"
    assert encode_line("TEMP?") == b"TEMP?\r\n"


@pytest.mark.parametrize("text", ["", "  ", "TEMP?\r\n", "TEMP, S10°", "\x00"])
def test_what_is_not_one_line_of_ascii_is_never_sent(text: str) -> None:
    with pytest.raises(UsageError, match="not one line"):
        encode_line(text)
