from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.errors import UsageError
from benchctl_instruments.protocols.acl import AROUND, AclCommand, encode_reply, parse_commands, reply_data
from benchctl_instruments.protocols.lines import LineCutter, UnreadableError


def command(text: str) -> AclCommand:
    (only,) = parse_commands(text)
    return only


def test_the_header_is_taken_off() -> None:
    assert reply_data("A7#0 4%tRate") == "Rate"
    assert reply_data("        12.5") == "12.5"
    assert reply_data("00000001 12.5000;0.0100;-0.3 ") == "12.5000;0.0100;-0.3"
    assert reply_data("00000003") == ""
    assert reply_data("Rate", header_length=0) == "Rate"


def test_blanks_of_a_header_are_kept_and_a_site_may_end_its_replies_otherwise() -> None:
    assert LineCutter(b"\r", trimmed=AROUND).feed(b"  000001OK\r  000002Rate\r") == ["  000001OK", "  000002Rate"]


def test_a_line_shorter_than_the_header_is_no_reply() -> None:
    with pytest.raises(UnreadableError, match="expected a header of 8 characters and data, got 'login: '"):
        reply_data("login: ")


def test_a_line_with_bytes_that_are_not_ascii_is_no_reply() -> None:
    (line,) = LineCutter(trimmed=AROUND).feed(b"0000\xff\xfe000112.5\r\n")
    with pytest.raises(UnreadableError, match="expected ASCII"):
        reply_data(line)


@settings(deadline=None)
@given(st.lists(st.text("0123456789.;-abcOK ", min_size=1).map(str.strip), max_size=5))
def test_what_the_controller_encodes_the_client_reads(datas: list[str]) -> None:
    stream = b"".join(encode_reply(f"{number:08d}", text) for number, text in enumerate(datas))
    assert [reply_data(line) for line in LineCutter(trimmed=AROUND).feed(stream)] == datas


@pytest.mark.parametrize(
    ("text", "path", "query", "arguments"),
    [
        (":demand:rate 1,10", ("demand", "rate"), False, ("1", "10")),
        (":dem:rate 1, 06.300", ("demand", "rate"), False, ("1", "06.300")),
        (":d:p 1,10", ("demand", "position"), False, ("1", "10")),
        (":D:A 1, 5 ", ("demand", "acceleration"), False, ("1", "5")),
        (":d:o 1,10,0.5,0", ("demand", "oscillator"), False, ("1", "10", "0.5", "0")),
        (":dem:delta 1,-90", ("demand", "delta"), False, ("1", "-90")),
        (":MODE:RATE 1", ("mode", "rate"), False, ("1",)),
        (":mode 1,rate", ("mode", "rate"), False, ("1",)),
        (":mode 1, POS", ("mode", "position"), False, ("1",)),
        (":M:A 1", ("mode", "arate"), False, ("1",)),
        (":mode:synt 1", ("mode", "synthesizer"), False, ("1",)),
        (":mode? 1", ("mode",), True, ("1",)),
        (":R:P 1", ("read", "position"), True, ("1",)),
        (":read:acc? 1", ("read", "acceleration"), True, ("1",)),
        (":Interlock:Reset", ("interlock", "reset"), False, ()),
        (":int:close 1", ("interlock", "close"), False, ("1",)),
        (":interlock? 1", ("interlock",), True, ("1",)),
        (":lim:acc pos,1,4200", ("limit", "acceleration"), False, ("pos", "1", "4200")),
        (":limit:absolute? 1", ("limit", "absolute"), True, ("1",)),
        (":L:V 1,900", ("limit", "vtrip"), False, ("1", "900")),
        (":L:L 1,-90", ("limit", "lposition"), False, ("1", "-90")),
        (
            ":con:osc 1,Enable,2.0,0.1,Pos,Lin",
            ("configure", "oscillator"),
            False,
            ("1", "Enable", "2.0", "0.1", "Pos", "Lin"),
        ),
        (":utility:lockout on", ("utility", "lockout"), False, ("on",)),
        ("*stb?", ("*stb",), True, ()),
        ("*IDN?", ("*idn",), True, ()),
    ],
)
def test_commands_seen_in_the_field_are_understood(
    text: str, path: tuple[str, ...], query: bool, arguments: tuple[str, ...]
) -> None:
    assert command(text) == AclCommand(path=path, query=query, arguments=arguments)


def test_a_semicolon_continues_in_the_same_subtree() -> None:
    paths = [item.path for item in parse_commands(":read:pos? 1;rate? 1;acc? 1")]
    assert paths == [("read", "position"), ("read", "rate"), ("read", "acceleration")]


def test_a_colon_after_a_semicolon_starts_at_the_root_again() -> None:
    paths = [item.path for item in parse_commands(":read:pos? 1 ; :mode? 1;*stb?")]
    assert paths == [("read", "position"), ("mode",), ("*stb",)]


@pytest.mark.parametrize(
    "text", [":", "::", ":jump 1", ":read:temp? 1", "*rst", ":mode 1", ":mode 1,fast", ":read:pos? 1;", "hello"]
)
def test_what_the_language_does_not_have_is_a_usage_error(text: str) -> None:
    with pytest.raises(UsageError):
        list(parse_commands(text))


@settings(deadline=None)
@given(st.text() | st.text(":;,?* readmo1"))
def test_no_line_breaks_the_parser(text: str) -> None:
    try:
        commands = list(parse_commands(text))
    except UsageError:
        return
    assert commands


def test_a_header_of_another_length_is_never_sent() -> None:
    with pytest.raises(UsageError, match="8 characters"):
        encode_reply("1", "OK")
