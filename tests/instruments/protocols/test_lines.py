from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.protocols.lines import MAX_LINE, LineCutter, encode_line, parse_number

TEXTS = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), min_size=1).map(str.strip).filter(bool)


def test_lines_end_with_lf_and_a_cr_before_it_does_not_count() -> None:
    assert LineCutter().feed(b"OK:TEMP\r\n23.0, 85.0\n") == ["OK:TEMP", "23.0, 85.0"]


def test_a_line_may_end_otherwise() -> None:
    assert LineCutter(b"\r").feed(b"1.5\r2.5\r\n") == ["1.5", "2.5"]
    assert LineCutter(None).feed(b"1\r2\n3\r\n4") == ["1", "2", "3"]
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
    assert encode_line("11004¶1", b"\r", encoding="latin-1") == b"11004\xb61\r"


@pytest.mark.parametrize("text", ["", "  ", "TEMP?\r\n", "TEMP, S10°", "\x00"])
def test_what_is_not_one_line_of_ascii_is_never_sent(text: str) -> None:
    with pytest.raises(UsageError, match="not one line"):
        encode_line(text)


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("0", 0.0),
        ("-0.000000", 0.0),
        ("+12.5", 12.5),
        (" -12.5 ", -12.5),
        ("12.", 12.0),
        (".5", 0.5),
        ("1.5E+003", 1500.0),
        ("2e-7", 2e-7),
        ("12345678901234567890", 12345678901234567890.0),
    ],
)
def test_a_number_is_digits_with_a_point_and_an_exponent_where_there_is_one(text: str, number: float) -> None:
    assert parse_number(text) == number


@pytest.mark.parametrize(
    "text",
    [
        *(
            "",
            " ",
            "fast",
            "nan",
            "-inf",
            "Infinity",
            "1_0",
            "1,5",
            "1;2",
            "1 2",
            "0x10",
            "+-1",
            "--1",
            "1e",
            "e5",
            ".",
        ),
        *("1e400", "1e9999", "1\n", "\t1", "\u0661", "\uff11", "1\x00", "1" * 21, "0." + "0" * 4000 + "1"),
    ],
)
def test_whatever_else_python_takes_for_a_number_is_an_instrument_error_in_one_short_line(text: str) -> None:
    with pytest.raises(InstrumentError, match="expected a number, got") as caught:
        parse_number(text)
    assert len(str(caught.value)) < 120
    assert "\n" not in str(caught.value)


@given(st.floats(-1e15, 1e15))
def test_a_number_as_any_instrument_prints_it_survives(number: float) -> None:
    assert parse_number(f"{number:.6f}") == pytest.approx(number, abs=1e-6)
    assert parse_number(f"{number:.17e}") == number


@given(st.text() | st.text("0123456789+-.eE_nainf "))
def test_no_text_breaks_the_reading_of_numbers(text: str) -> None:
    said = ""
    try:
        assert math.isfinite(parse_number(text))
    except InstrumentError as err:
        said = str(err)
    assert said.isprintable()
