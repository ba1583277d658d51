from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl_instruments.errors import InstrumentError, LinkError
from benchctl_instruments.protocols.t7_stream import DUMMY, ScanRun, StreamReader, encode_packets

LITERAL = bytes.fromhex(
    "0007 0000 0012 01 4C 10 00 0010 0000 0000"  # transaction 7, 18 bytes follow, backlog 16 bytes, no status
    "0001 0002 8000 FFFE"
)


def ramp(scans: int, length: int = 4) -> npt.NDArray[np.uint16]:
    """Scans that carry their own index, shape (scans, length)."""
    samples = np.zeros((scans, length), np.uint16)
    samples[:, 0] = np.arange(scans)
    return samples


def packed(samples: npt.NDArray[np.uint16], width: int, **fields: int) -> bytes:
    """Samples as packets of `width`, which must divide their number."""
    return encode_packets(samples.reshape(-1, width), **{"first_transaction": 0, **fields})


def indices(runs: list[ScanRun]) -> list[int]:
    """What the first sample of each scan says, which is its true index."""
    return [int(index) for run in runs for index in run.samples[:, 0]]


def stated(runs: list[ScanRun]) -> list[int]:
    """The indices that the reader gives to the scans."""
    return [index for run in runs for index in range(run.first_index, run.next_index)]


def test_the_packet_of_the_document_is_encoded_to_the_last_byte() -> None:
    samples = np.array([[1, 2, 0x8000, 0xFFFE]])
    assert encode_packets(samples, first_transaction=7, backlog_bytes=16) == LITERAL


def test_the_packet_of_the_document_is_one_scan() -> None:
    reader = StreamReader(4)
    (run,) = reader.feed(LITERAL)
    assert run.first_index == 0
    assert run.samples.tolist() == [[1, 2, 0x8000, 0xFFFE]]
    assert reader.backlog_scans == 2


def test_transaction_numbers_go_up_by_one_and_wrap() -> None:
    data = encode_packets(np.zeros((3, 1)), first_transaction=0xFFFE)
    assert [data[at : at + 2].hex() for at in (0, 18, 36)] == ["fffe", "ffff", "0000"]
    reader = StreamReader(1)
    assert len(reader.feed(data)[0].samples) == 3
    assert reader.lost_packets == 0


def test_a_backlog_of_more_than_two_bytes_is_stated_as_the_largest() -> None:
    assert encode_packets(np.zeros((1, 1)), first_transaction=0, backlog_bytes=70_000)[10:12] == b"\xff\xff"


@given(st.lists(st.integers(1, 60), min_size=1, max_size=40), st.integers(1, 12))
def test_packets_cut_anywhere_and_scans_across_packets_give_the_same_scans(cuts: list[int], width: int) -> None:
    samples = ramp(12)
    data = packed(samples, width if 48 % width == 0 else 6)
    reader, runs, place = StreamReader(4), [], 0
    for cut in [*cuts, len(data)]:
        runs += reader.feed(data[place : place + cut])
        place += cut
    runs += reader.feed(data[place:])
    assert np.concatenate([run.samples for run in runs]).tolist() == samples.tolist()
    assert stated(runs) == list(range(12))


def test_packets_of_another_length_in_between_are_read_too() -> None:
    samples = ramp(10)
    data = packed(samples[:4], 8) + packed(samples[4:], 4, first_transaction=2)
    runs = StreamReader(4).feed(data)
    assert indices(runs) == stated(runs) == list(range(10))


@given(st.integers(1, 9), st.integers(1, 5), st.sampled_from([3, 4, 6, 8]))
def test_scans_after_a_lost_packet_keep_their_true_index(first: int, count: int, width: int) -> None:
    samples = ramp(24)
    packets = samples.reshape(-1, width)
    count = min(count, len(packets) - first)
    data = encode_packets(packets[:first], first_transaction=65530)
    data += encode_packets(packets[first + count :], first_transaction=65530 + first + count)
    reader = StreamReader(4)
    runs = reader.feed(data)
    assert indices(runs) == stated(runs)
    whole_before = first * width // 4
    torn_after = -(-(first + count) * width // 4)
    if (first + count) * width < 96:
        assert stated(runs) == [*range(whole_before), *range(torn_after, 24)]
        assert reader.lost_packets == count


def test_an_end_of_recovery_opens_a_gap_at_the_dummy_scan() -> None:
    samples = ramp(8)
    samples[3] = DUMMY
    samples[4:, 0] += 100 - 1  # a hundred scans were skipped, and the dummy is one of them
    reader = StreamReader(4)
    runs = reader.feed(
        packed(samples[:2], 8, status=2940)
        + packed(samples[2:6], 16, first_transaction=1, status=2941, additional=100)
        + packed(samples[6:], 8, first_transaction=2)
    )
    assert stated(runs) == indices(runs) == [0, 1, 2, 103, 104, 105, 106]
    assert reader.skipped_scans == 100
    assert reader.lost_packets == 0


def test_a_dummy_scan_may_end_in_the_packet_after_the_status() -> None:
    samples = ramp(6)
    samples[2] = DUMMY
    samples[3:, 0] += 9
    first, rest = samples.reshape(-1)[:10], samples.reshape(-1)[10:]
    reader = StreamReader(4)
    runs = reader.feed(encode_packets(first.reshape(1, -1), first_transaction=0, status=2941, additional=10))
    assert stated(runs) == [0, 1]
    runs += reader.feed(encode_packets(rest.reshape(1, -1), first_transaction=1))
    assert stated(runs) == indices(runs) == [0, 1, 12, 13, 14]


def test_scans_of_nothing_but_ones_are_data_where_no_recovery_ended() -> None:
    samples = np.full((3, 4), DUMMY, np.uint16)
    assert stated(StreamReader(4).feed(packed(samples, 4))) == [0, 1, 2]


def test_an_end_of_recovery_without_a_dummy_scan_is_an_instrument_error() -> None:
    reader = StreamReader(4)
    reader.feed(packed(ramp(2), 8, status=2941, additional=5))
    with pytest.raises(InstrumentError, match=r"skipped 5 scans.*dummy scan"):
        reader.feed(packed(ramp(2), 8, first_transaction=1))


@pytest.mark.parametrize(
    ("status", "words"),
    [(2942, "before the one before it had ended"), (2943, "lost count"), (2944, "burst"), (17, "unknown")],
)
def test_a_status_that_ends_the_stream_is_an_instrument_error_in_words(status: int, words: str) -> None:
    with pytest.raises(InstrumentError, match=rf"status {status}: .*{words}"):
        StreamReader(4).feed(packed(ramp(2), 8, status=status))


@pytest.mark.parametrize(
    "data",
    [
        b"HTTP/1.1 400 Bad Request\r\n",
        LITERAL.replace(b"\x01\x4c", b"\x01\x03"),
        LITERAL[:4] + b"\x00\x0a" + LITERAL[6:],  # no sample at all
        LITERAL[:4] + b"\x00\x13" + LITERAL[6:],  # half a sample
        LITERAL[:4] + b"\x08\x00" + LITERAL[6:],  # more than 512 samples
    ],
)
def test_bytes_that_are_no_packet_are_a_link_error_that_shows_them(data: bytes) -> None:
    with pytest.raises(LinkError, match=data[:4].hex(" ")):
        StreamReader(4).feed(data)


def test_good_packets_before_bytes_that_are_none_are_not_lost_with_them() -> None:
    reader = StreamReader(4)
    assert len(reader.feed(LITERAL + bytes.fromhex("deadbeef") * 6)) == 1
    with pytest.raises(LinkError, match="de ad be ef"):
        reader.feed(b"")


@pytest.mark.parametrize("junk", [b"\xff" * 16, b"\x00", bytes.fromhex("01 4c 10"), b"\x00" * 5])
def test_bytes_between_two_packets_are_left_out(junk: bytes) -> None:
    data = packed(ramp(30), 20)
    size = len(data) // 6
    reader = StreamReader(4)
    runs = reader.feed(data[: 2 * size] + junk + data[2 * size :])
    assert indices(runs) == list(range(30))
    assert (reader.junk_bytes, reader.lost_packets) == (len(junk), 0)


def test_a_new_connection_begins_with_a_whole_packet_and_what_never_came_is_a_gap() -> None:
    data = packed(ramp(60), 20)
    size = len(data) // 12
    reader = StreamReader(4)
    before = reader.feed(data[: 3 * size + 10])
    reader.resume()
    after = reader.feed(data[5 * size :])
    assert [(run.first_index, len(run.samples)) for run in (*before, *after)] == [(0, 15), (25, 35)]
    assert reader.lost_packets == 2


def test_a_minute_at_a_hundred_thousand_samples_a_second_costs_a_twentieth_of_a_processor_at_most() -> None:
    data = packed(ramp(128 * 200), 512)  # about a second's worth
    reader, transaction = StreamReader(4), 0
    started_s = time.process_time()
    for _ in range(60):
        reader.feed(data)
        reader._next_transaction = transaction  # the same bytes again
    assert time.process_time() - started_s < 60 * 0.05
