"""Requests out of literal bytes, replies to literal bytes.

The frames are those printed in the MODBUS Application Protocol 1.1b3 (chapters 6.3, 6.6, 6.12) and in tutorials that
print whole RTU frames; where a CRC had to be computed it was done by another program (pymodbus' framer).
"""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.framer import FramerRTU

from benchctl_instruments.protocols.modbus import (
    ILLEGAL_ADDRESS,
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    Request,
    RtuFraming,
    ServerFraming,
    TcpFraming,
    crc16,
    exception_words,
    with_crc,
)

READ_3_FROM_6B = bytes.fromhex("11 03 00 6B 00 03 76 87")  # unit 17, the usual example of tutorials
WRITE_ONE = bytes.fromhex("11 06 00 01 00 03 9A 9B")
WRITE_TWO = bytes.fromhex("11 10 00 01 00 02 04 00 0A 01 02 C6 F0")
READ_1_FROM_100_UNIT_1 = bytes.fromhex("01 03 00 64 00 01 C5 D5")


def tcp(transaction: int, unit: int, pdu: str) -> bytes:
    body = bytes([unit]) + bytes.fromhex(pdu)
    return transaction.to_bytes(2, "big") + b"\x00\x00" + len(body).to_bytes(2, "big") + body


def test_published_rtu_frames_are_understood() -> None:
    assert RtuFraming().feed(READ_3_FROM_6B) == [Request(unit=17, function=3, address=0x6B, count=3)]
    assert RtuFraming().feed(WRITE_ONE) == [Request(unit=17, function=6, address=1, count=1, values=(3,))]
    assert RtuFraming().feed(WRITE_TWO) == [Request(unit=17, function=16, address=1, count=2, values=(0x0A, 0x0102))]


def test_published_rtu_replies_are_given() -> None:
    framing = RtuFraming()
    read, one, two = framing.feed(READ_3_FROM_6B + WRITE_ONE + WRITE_TWO)
    assert framing.reply(read, [0xAE41, 0x5652, 0x4340]) == bytes.fromhex("11 03 06 AE 41 56 52 43 40 49 AD")
    assert framing.reply(one) == WRITE_ONE
    assert framing.reply(two) == bytes.fromhex("11 10 00 01 00 02 12 98")


def test_the_read_example_of_the_standard_is_answered_over_tcp() -> None:
    framing = TcpFraming()
    [request] = framing.feed(tcp(0x1501, 0xFF, "03 00 6B 00 03"))
    assert framing.reply(request, [0x022B, 0x0000, 0x0064]) == bytes.fromhex(
        "15 01 00 00 00 09 FF 03 06 02 2B 00 00 00 64"
    )


def test_a_refusal_is_the_function_with_its_top_bit_and_the_code() -> None:
    framing = TcpFraming()
    [request] = framing.feed(tcp(7, 1, "03 00 6B 00 03"))
    assert framing.refuse(request, ILLEGAL_ADDRESS) == bytes.fromhex("00 07 00 00 00 03 01 83 02")
    [request] = RtuFraming().feed(READ_1_FROM_100_UNIT_1)
    assert RtuFraming().refuse(request, ILLEGAL_ADDRESS) == bytes.fromhex("01 83 02 C0 F1")


@given(st.binary(min_size=1, max_size=60))
def test_the_crc_is_the_one_that_pymodbus_computes(data: bytes) -> None:
    assert with_crc(data)[-2:] == FramerRTU.compute_CRC(data).to_bytes(2, "big")
    assert crc16(with_crc(data)) == 0


def test_the_crc_of_123456789_is_the_catalogued_check_value() -> None:
    assert crc16(b"123456789") == 0x4B37


@pytest.mark.parametrize(
    ("framing", "stream"),
    [
        (RtuFraming(), READ_3_FROM_6B + WRITE_ONE + WRITE_TWO),
        (
            TcpFraming(),
            tcp(1, 17, "03 00 6B 00 03") + tcp(2, 17, "06 00 01 00 03") + tcp(3, 17, "10 00 01 00 02 04 00 0A 01 02"),
        ),
    ],
)
def test_requests_that_arrive_byte_by_byte_are_the_same_requests(framing: ServerFraming, stream: bytes) -> None:
    together = framing.feed(stream)
    one_by_one = [request for byte in stream for request in framing.feed(bytes([byte]))]
    assert [request.function for request in together] == [3, 6, 16]
    assert one_by_one == together


def test_pipelined_tcp_requests_keep_their_transactions_in_order() -> None:
    stream = b"".join(tcp(number, 1, "03 00 00 00 01") for number in (300, 5, 65535))
    assert [request.transaction for request in TcpFraming().feed(stream)] == [300, 5, 65535]


@pytest.mark.parametrize(
    "noise",
    [
        b"\x00",
        b"\xff" * 5,
        b"\x01\x03",  # the head of a read
        b"\x01\x10\x00\x00\x00\x7b\xf6",  # the head of the longest write there is
        READ_1_FROM_100_UNIT_1[:-1],
        READ_1_FROM_100_UNIT_1[:-1] + b"\x00",  # a damaged CRC
        bytes(700),
    ],
)
def test_a_frame_behind_noise_on_the_line_is_found(noise: bytes) -> None:
    framing = RtuFraming()
    assert framing.feed(noise) == []
    assert framing.feed(READ_3_FROM_6B) == [Request(unit=17, function=3, address=0x6B, count=3)]


@given(st.lists(st.one_of(st.binary(max_size=30), st.just(READ_3_FROM_6B)), max_size=12))
def test_no_bytes_whatever_break_the_rtu_framing(pieces: list[bytes]) -> None:
    framing = RtuFraming()
    found = [request for piece in pieces for request in framing.feed(piece)]
    wanted = Request(unit=17, function=3, address=0x6B, count=3)
    assert found.count(wanted) >= pieces.count(READ_3_FROM_6B) - sum(piece != READ_3_FROM_6B for piece in pieces)


@given(st.lists(st.binary(max_size=30), max_size=12))
def test_no_bytes_whatever_break_the_tcp_framing(pieces: list[bytes]) -> None:
    framing = TcpFraming()
    for piece in pieces:
        assert all(request.count >= 0 for request in framing.feed(piece))


def test_a_stream_that_is_not_modbus_tcp_is_dropped_and_the_next_request_is_heard() -> None:
    framing = TcpFraming()
    assert framing.feed(b"GET / HTTP/1.1\r\n\r\n") == []
    assert len(framing.feed(tcp(1, 1, "03 00 00 00 01"))) == 1


@pytest.mark.parametrize(
    ("pdu", "fault"),
    [
        ("03 00 00 00 00", ILLEGAL_VALUE),  # no register at all
        ("03 00 00 00 7E", ILLEGAL_VALUE),  # 126
        ("03 FF FF 00 02", ILLEGAL_ADDRESS),  # beyond the last register
        ("03 00 00 00", ILLEGAL_VALUE),  # too short
        ("10 00 01 00 02 03 00 0A 01", ILLEGAL_VALUE),  # three bytes for two registers
        ("10 00 01 00 02 04 00 0A", ILLEGAL_VALUE),  # says four bytes and brings two
        ("01 00 00 00 01", ILLEGAL_FUNCTION),  # coils
        ("2B 0E 01 00", ILLEGAL_FUNCTION),
    ],
)
def test_a_request_that_is_wrong_by_its_form_says_what_it_deserves(pdu: str, fault: int) -> None:
    [request] = TcpFraming().feed(tcp(9, 1, pdu))
    assert (request.fault, request.transaction) == (fault, 9)


def test_an_exception_is_told_in_words_also_where_the_standard_knows_none() -> None:
    assert exception_words(2) == "exception 2 (illegal data address)"
    assert exception_words(99) == "exception 99 (not in the standard)"
