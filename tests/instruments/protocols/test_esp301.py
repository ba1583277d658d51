from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols.esp301 import (
    ANSWER_END,
    Error,
    Esp301Command,
    held_an_error,
    is_unasked,
    parse_commands,
    parse_error,
    parse_flag,
)
from benchctl_instruments.protocols.lines import LineCutter, parse_number

TEXTS = st.text() | st.text("0123456789.,;?+-eE TBVAMPX")


@pytest.mark.parametrize(
    ("line", "commands"),
    [
        ("1VA50.000000", [Esp301Command(axis=1, name="VA", value="50.000000")]),
        ("1MV+", [Esp301Command(axis=1, name="MV", value="+")]),
        ("3MV-", [Esp301Command(axis=3, name="MV", value="-")]),
        ("01TP?", [Esp301Command(axis=1, name="TP", query=True)]),
        ("01MD", [Esp301Command(axis=1, name="MD")]),
        ("TE?", [Esp301Command(axis=None, name="TE", query=True)]),
        ("te?", [Esp301Command(axis=None, name="TE", query=True)]),
        ("1DH-0.5", [Esp301Command(axis=1, name="DH", value="-0.5")]),
        (
            "1PA+30; 1WS; 2PR-10",
            [
                Esp301Command(axis=1, name="PA", value="+30"),
                Esp301Command(axis=1, name="WS"),
                Esp301Command(axis=2, name="PR", value="-10"),
            ],
        ),
        ("1MO;;", [Esp301Command(axis=1, name="MO")]),
        ("MOTOR ON;1MO", [Esp301Command(axis=None, name="MO", value="TORON"), Esp301Command(axis=1, name="MO")]),
        ("1;?;TE?", [None, None, Esp301Command(axis=None, name="TE", query=True)]),
        ("", []),
    ],
)
def test_commands_of_a_line(line: str, commands: list[Esp301Command | None]) -> None:
    assert list(parse_commands(line)) == commands


@pytest.mark.parametrize(
    ("answer", "code", "text", "fault"),
    [
        ("4", 4, "emergency stop", True),
        ("6", 6, "no such command", False),
        ("9, 451322, AXIS NUMBER OUT OF RANGE", 9, "no such axis", False),
        ("104", 104, "axis 1: positive hardware limit", True),
        ("107", 107, "axis 1: negative software limit", True),
        ("113", 113, "axis 1: motor not enabled", False),
        ("208", 208, "axis 2: motor or stage not connected", True),
        ("399", 399, "axis 3: unknown", False),
        ("55", 55, "unknown", False),
    ],
)
def test_an_error_is_named_and_a_fault_is_told_from_a_wrong_command(
    answer: str, code: int, text: str, fault: bool
) -> None:
    error = parse_error(answer)
    assert error == Error(code=code)
    assert str(error) == f"{code} ({text})"
    assert error.fault is fault


@pytest.mark.parametrize("answer", ["0", "0, 451322, NO ERROR DETECTED", "000"])
def test_an_empty_queue_answers_0(answer: str) -> None:
    assert parse_error(answer) is None


@pytest.mark.parametrize("answer", ["", "NO ERROR", "-1", "1000", "1.0", "E38", "\u0663"])
def test_what_is_no_code_is_an_instrument_error(answer: str) -> None:
    with pytest.raises(InstrumentError, match="expected the code of an error, 0 to 999, got"):
        parse_error(answer)


@pytest.mark.parametrize(
    ("damaged", "held"),
    [
        ("0Z", False),
        ("0\\xff\\x00Z", False),
        ("\\x910", False),  # the digits of an escape are none
        ("10\\xff4", True),
        ("1\\xff", True),
        ("\\xff\\xfe", True),
        ("none", True),
        ("00, 4513", True),
    ],
)
def test_of_an_answer_that_cannot_be_read_only_a_0_that_is_left_says_that_there_was_no_error(
    damaged: str, held: bool
) -> None:
    assert held_an_error(damaged) is held


def test_an_error_whose_code_was_lost_says_so_and_counts_as_a_fault() -> None:
    lost = Error(code=None)
    assert str(lost) == "an error whose code was lost on the line"
    assert lost.fault


def test_a_long_answer_is_shown_by_its_beginning() -> None:
    for parse in (parse_error, parse_flag):
        with pytest.raises(InstrumentError) as caught:
            parse("7" * 4000)
        assert len(str(caught.value)) < 160


def test_a_flag_is_0_or_1() -> None:
    assert parse_flag("1")
    assert not parse_flag("0")
    for answer in ("", "2", "01", "yes", "1.0"):
        with pytest.raises(InstrumentError, match="expected 0 or 1"):
            parse_flag(answer)


@pytest.mark.parametrize(
    ("line", "unasked"),
    [("E38", True), ("E 42", True), ("E35 HARD LIMIT", True), ("ESP301 Version 3.0.1", False), ("1", False)],
)
def test_an_error_that_nobody_asked_for_is_told_from_an_answer(line: str, unasked: bool) -> None:
    assert is_unasked(line) is unasked


@settings(deadline=None)
@given(TEXTS)
def test_no_line_breaks_a_parser(line: str) -> None:
    messages: list[str] = []
    assert len(list(parse_commands(line))) <= line.count(";") + 1
    assert is_unasked(line) in (True, False)
    for parse in (parse_error, parse_flag, parse_number):
        try:
            parse(line)
        except InstrumentError as err:
            messages.append(str(err))
    assert all(message.isprintable() for message in messages)


@settings(deadline=None)
@given(st.binary(max_size=200), st.binary(max_size=200))
def test_whatever_came_before_the_answers_that_follow_are_whole(first: bytes, second: bytes) -> None:
    lines = LineCutter(ANSWER_END)
    lines.feed(first)
    lines.feed(second)
    answers = lines.feed(ANSWER_END + b"104\r\n-12.5\r\n")
    assert parse_error(answers[-2]) == Error(code=104)
    assert parse_number(answers[-1]) == -12.5
