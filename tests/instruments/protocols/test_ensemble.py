from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.protocols.ensemble import (
    END,
    AxisStatus,
    EnsembleCommand,
    Outcome,
    Reply,
    encode_reply,
    fault_names,
    is_bare,
    parse_bits,
    parse_command,
    parse_reply,
    written_bits,
)
from benchctl_instruments.protocols.lines import LineCutter, parse_number

TEXTS = st.text() | st.text("%!#$@X(), 0123456789.-+eEABORTFREUN")


@pytest.mark.parametrize(
    ("line", "outcome", "data"),
    [
        ("%", Outcome.DONE, ""),
        ("%-1675099646", Outcome.DONE, "-1675099646"),
        ("% 12.5 ", Outcome.DONE, "12.5"),
        ("!", Outcome.NOT_UNDERSTOOD, ""),
        ("#axis is disabled", Outcome.REFUSED, "axis is disabled"),
        ("$", Outcome.NOT_IN_TIME, ""),
    ],
)
def test_the_first_character_of_a_reply_says_what_became_of_it(line: str, outcome: Outcome, data: str) -> None:
    assert parse_reply(line) == Reply(outcome=outcome, data=data)


@pytest.mark.parametrize("line", ["", "12.5", "OK", " %", "HTTP/1.1 400 Bad Request"])
def test_what_begins_otherwise_is_no_reply(line: str) -> None:
    with pytest.raises(InstrumentError, match="expected a line that begins with %, !, # or"):
        parse_reply(line)


def test_a_bare_line_is_a_percent_sign_and_nothing_else() -> None:
    assert is_bare("%")
    assert not is_bare("%0")
    assert not is_bare("!")


def test_a_status_as_a_real_one_was_seen_to_answer_has_its_highest_bit_on() -> None:
    word = parse_bits("-1675099646")
    assert word == 2**32 - 1675099646
    assert AxisStatus(word) & AxisStatus.EMERGENCY_STOP_INPUT
    assert not AxisStatus(word) & AxisStatus.ENABLED
    assert written_bits(word) == "-1675099646"


@given(st.integers(0, 2**32 - 1))
def test_a_word_of_bits_survives_its_signed_and_its_unsigned_spelling(word: int) -> None:
    assert parse_bits(written_bits(word)) == word
    assert parse_bits(str(word)) == word


@pytest.mark.parametrize("data", ["", "1.5", "0x10", "9999999999", "-2147483649", "+-1", "1 2", "\u0661"])
def test_what_is_no_word_of_32_bits_is_an_instrument_error(data: str) -> None:
    with pytest.raises(InstrumentError, match="expected an integer of 32 bits"):
        parse_bits(data)


def test_a_long_reply_is_shown_by_its_beginning() -> None:
    for parse in (parse_reply, parse_bits):
        with pytest.raises(InstrumentError) as caught:
            parse("7" * 4000)
        assert len(str(caught.value)) < 160


def test_faults_are_named_and_an_unknown_one_keeps_its_number() -> None:
    assert fault_names(0x004) == ("clockwise end of travel",)
    assert fault_names(0x008 | 0x800 | 1 << 31) == ("counter-clockwise end of travel", "emergency stop", "bit 31")
    assert fault_names(0) == ()


@pytest.mark.parametrize(
    ("line", "name", "arguments"),
    [
        ("ENABLE X", "ENABLE", ("X",)),
        ("FAULTACK @0", "FAULTACK", ("@0",)),
        ("freerun @0 -12.5", "FREERUN", ("@0", "-12.5")),
        ("AXISSTATUS(@0)", "AXISSTATUS", ("@0",)),
        ("AXISFAULT @0", "AXISFAULT", ("@0",)),
        ("PFBK(X)", "PFBK", ("X",)),
        ("PLANESTATUS(0)", "PLANESTATUS", ("0",)),
        ("GETPARM(@0, 73)", "GETPARM", ("@0", "73")),
        ("SETPARM @0, 73, 500.0", "SETPARM", ("@0", "73", "500.0")),
        ("RAMP MODE @0 RATE", "RAMP MODE", ("@0", "RATE")),
        ("ramp rate 500", "RAMP RATE", ("500",)),
        ("WAIT MODE NOWAIT", "WAIT MODE", ("NOWAIT",)),
        ("LINEAR @0 10.000 F5.0", "LINEAR", ("@0", "10.000", "F5.0")),
        (" ABS ", "ABS", ()),
        ("RAMP", "RAMP", ()),
    ],
)
def test_commands_seen_in_the_field_are_understood(line: str, name: str, arguments: tuple[str, ...]) -> None:
    assert parse_command(line) == EnsembleCommand(name=name, arguments=arguments)


@pytest.mark.parametrize("line", ["", "(", "12", "@0 ENABLE", "ENA-BLE X"])
def test_a_line_without_a_name_is_no_command(line: str) -> None:
    with pytest.raises(UsageError, match="is no command"):
        parse_command(line)


def test_a_reply_leaves_with_a_line_feed() -> None:
    assert encode_reply(Reply(outcome=Outcome.DONE, data="1.5")) == b"%1.5\n"
    assert encode_reply(Reply(outcome=Outcome.NOT_UNDERSTOOD)) == b"!\n"


@settings(deadline=None)
@given(TEXTS)
def test_no_line_breaks_a_parser(line: str) -> None:
    messages: list[str] = []
    for parse, expected in (
        (parse_reply, InstrumentError),
        (parse_bits, InstrumentError),
        (parse_number, InstrumentError),
        (parse_command, UsageError),
    ):
        try:
            parse(line)
        except expected as err:
            messages.append(str(err))
    assert all(message.isprintable() for message in messages)


@settings(deadline=None)
@given(st.binary(max_size=200), st.binary(max_size=200))
def test_whatever_came_before_the_replies_that_follow_are_whole(first: bytes, second: bytes) -> None:
    lines = LineCutter(END)
    lines.feed(first)
    lines.feed(second)
    answers = lines.feed(END + b"%-12\n!\n")
    assert [parse_reply(answer) for answer in answers[-2:]] == [
        Reply(outcome=Outcome.DONE, data="-12"),
        Reply(outcome=Outcome.NOT_UNDERSTOOD),
    ]
