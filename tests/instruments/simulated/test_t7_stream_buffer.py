from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols.t7_stream import StreamReader
from benchctl_instruments.simulated.t7_stream_server import LARGEST_BATCH, StreamBuffer, StreamSettings

RATE_HZ = 1000.0
ROOM = 512  # scans of 4 samples in a buffer of 4096 bytes


def buffer(*, samples_per_packet: int = 40, rate_hz: float = RATE_HZ) -> StreamBuffer:
    """A stream from 2 s on, whose scans carry their own index (modulo 65536)."""

    def sample(start: int, scans: int) -> npt.NDArray[np.uint16]:
        samples = np.zeros((scans, 4), np.uint16)
        samples[:, 0] = np.arange(start, start + scans) & 0xFFFF
        return samples

    settings = StreamSettings(
        first_s=2.0,
        rate_hz=rate_hz,
        scan_length=4,
        samples_per_packet=samples_per_packet,
        buffer_bytes=4096,
        sample=sample,
    )
    return StreamBuffer(settings)


def drained(stream: StreamBuffer, now_s: float) -> bytes:
    """All packets that there are at an instant."""
    data = b""
    while packets := stream.packets(now_s):
        data += packets
    return data


def test_nothing_is_due_before_the_first_scan_and_packets_leave_only_when_they_are_full() -> None:
    stream = buffer()
    assert stream.packets(2.0) == b""
    assert stream.packets(2.009) == b""
    assert len(stream.packets(2.01)) == stream.packet_bytes
    assert stream.packets(2.01) == b""


@pytest.mark.parametrize("samples_per_packet", [1, 3, 40, 64, 510, 512])
def test_scans_come_whole_and_in_order_whatever_the_packets_and_the_pace(samples_per_packet: int) -> None:
    stream, reader = buffer(samples_per_packet=samples_per_packet), StreamReader(4)
    found: list[int] = []
    for now_s in (2.0, 2.0005, 2.3, 2.301, 3.0, 12.0, 22.0):
        for run in reader.feed(drained(stream, now_s)):
            assert run.first_index == len(found)
            found += run.samples[:, 0].tolist()
    assert found == list(range(len(found)))
    assert 20_000 - len(found) <= samples_per_packet / 4 + 1


def test_a_long_jump_is_sampled_in_batches() -> None:
    assert len(buffer().packets(1000.0)) <= (LARGEST_BATCH * 8) * 1.3


def test_the_backlog_is_what_still_waits_after_each_packet() -> None:
    reader = StreamReader(4)
    stream = buffer()
    reader.feed(stream.packets(2.1))
    assert reader.backlog_scans == 0
    data = stream.packets(2.2)
    reader.feed(data[: stream.packet_bytes])
    assert reader.backlog_scans == 90


def test_the_next_packet_is_full_when_it_says() -> None:
    stream = buffer()
    drained(stream, 2.1234)
    assert not stream.packets(stream.next_packet_s - 1e-4)
    assert stream.packets(stream.next_packet_s)


def test_a_full_buffer_keeps_the_oldest_scans_and_counts_what_it_skips() -> None:
    stream, reader = buffer(), StreamReader(4)
    reader.feed(drained(stream, 2.1))
    stream.fill(2.1 + 0.5, in_transit=100)  # 500 scans more fit
    stream.fill(2.1 + 5.0, in_transit=100)  # 5000 do not
    runs = reader.feed(drained(stream, 2.1 + 5.0))
    runs += reader.feed(drained(stream, 2.1 + 5.5))
    stated = [index for run in runs for index in range(run.first_index, run.next_index)]
    assert stated == [int(index) for run in runs for index in run.samples[:, 0]]
    assert stated[:ROOM] == list(range(100, 100 + ROOM))
    assert stated[ROOM] >= 5100
    assert reader.skipped_scans == stated[ROOM] - (100 + ROOM)


def test_an_unread_stream_of_hours_ends_with_what_the_buffer_holds() -> None:
    stream = buffer()
    stream.finish(2.0 + 36_000.0)
    assert stream.packets(2.0 + 36_000.0) == b""
    assert stream.next_scan_s >= 2.0 + 36_000.0


def test_more_skipped_scans_than_can_be_counted_end_the_stream() -> None:
    stream, reader = buffer(), StreamReader(4)
    stream.fill(2.0 + 100.0, in_transit=0)
    reader.feed(drained(stream, 2.0 + 100.0))
    data = drained(stream, 2.0 + 101.0)
    assert stream.over
    with pytest.raises(InstrumentError, match="2943"):
        reader.feed(data)


def test_too_high_a_rate_ends_the_stream_with_its_first_packet() -> None:
    stream = buffer(rate_hz=30_000.0)
    data = stream.packets(3.0)
    assert len(data) == stream.packet_bytes
    assert stream.over
    with pytest.raises(InstrumentError, match="2942"):
        StreamReader(4).feed(data)
