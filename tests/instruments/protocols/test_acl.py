from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.protocols.acl import (
    AclCommand,
    AclLines,
    Reply,
    ReplyReader,
    encode,
    encode_reply,
    parse_commands,
)
from benchctl_instruments.protocols.lines import MAX_LINE


def command(text: str) -> AclCommand:
    (only,) = parse_commands(text)
    return only


def test_a_command_is_a_line_of_ascii_with_carriage_return_and_line_feed() -> None:
    assert encode(":dem:rate 1,10.000000") == b":dem:rate 1,10.000000\r\n"


@pytest.mark.parametrize("text", ["", "  ", ":mode? 1\r\n", ":dem:rate 1,10°", "\x00"])
def test_what_is_not_one_line_of_ascii_is_never_sent(text: str) -> None:
    with pytest.raises(UsageError, match="not one line"):
        encode(text)


def test_the_header_is_taken_off_and_kept() -> None:
    assert ReplyReader().feed(b"A7#0 4%tRate\r\n") == [Reply(header="A7#0 4%t", data="Rate")]


def test_ok_acknowledges_and_nothing_else_does() -> None:
    replies = ReplyReader().feed(b"00000001OK\r\n00000002 ok \r\n00000003\r\n00000004OKAY\r\n00000005ERROR\r\n")
    assert [reply.ok for reply in replies] == [True, True, False, False, False]


def test_a_combined_read_comes_back_as_one_reply() -> None:
    (reply,) = ReplyReader().feed(b"00000001 12.5000;0.0100;-0.3\n")
    assert reply.data == "12.5000;0.0100;-0.3"


def test_a_reply_split_over_two_packets_is_one_reply() -> None:
    reader = ReplyReader()
    assert reader.feed(b"0000") == []
    assert reader.feed(b"0001OK\r") == []
    assert reader.feed(b"\n") == [Reply(header="00000001", data="OK")]


def test_empty_lines_and_bare_line_feeds_are_survived() -> None:
    assert [reply.data for reply in ReplyReader().feed(b"\r\n\n00000001OK\n\r\n00000002Rate\r\n")] == ["OK", "Rate"]


@settings(deadline=None)
@given(st.lists(st.text("0123456789.;-abcOK ", min_size=1).map(str.strip), max_size=5), st.data())
def test_however_the_stream_is_cut_the_replies_are_the_same(datas: list[str], data: st.DataObject) -> None:
    stream = b"".join(encode_reply(f"{number:08d}", text) for number, text in enumerate(datas))
    cuts = sorted(data.draw(st.sets(st.integers(0, len(stream)))))
    reader = ReplyReader()
    replies: list[Reply] = []
    for low, high in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        replies += reader.feed(stream[low:high])
    assert [reply.data for reply in replies] == datas


def test_a_line_without_an_end_is_given_up_and_the_memory_let_go() -> None:
    lines = AclLines()
    with pytest.raises(InstrumentError, match=rf"more than {MAX_LINE} bytes.*this is not ACL"):
        lines.feed(b"x" * (MAX_LINE + 1))
    assert lines.feed(b"fresh\n") == ["fresh"]


def test_a_line_shorter_than_the_header_is_no_reply() -> None:
    with pytest.raises(InstrumentError, match=r"'login: ', is shorter than ACL's header of 8"):
        ReplyReader().feed(b"login: \r\n")


def test_bytes_that_are_not_ascii_show_as_escapes() -> None:
    (reply,) = ReplyReader().feed(b"00000001\xff\xfe\r\n")
    assert reply.data == r"\xff\xfe"


def test_a_site_may_end_its_replies_otherwise() -> None:
    assert ReplyReader(b"\r").feed(b"00000001OK\r00000002Rate\r") == [
        Reply(header="00000001", data="OK"),
        Reply(header="00000002", data="Rate"),
    ]


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


def test_a_line_beyond_the_longest_is_no_reply_even_with_its_end() -> None:
    reader = ReplyReader()
    with pytest.raises(InstrumentError, match="more than 4096 bytes without an end of line"):
        reader.feed(b"hhhhhhhh" + b"1" * 5000 + b"\r\n")
    assert [reply.data for reply in reader.feed(b"hhhhhhhhOK\r\n")] == ["OK"]
