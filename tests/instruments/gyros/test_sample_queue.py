from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.gyros.framed_gyro import SampleQueue, Samples
from benchctl_instruments.interfaces import GyroCounts, GyroGap
from benchctl_instruments.protocols import kvh1760 as kvh
from benchctl_instruments.protocols.frames import ByteArray, SequenceNumbers

RATE_HZ = 1000.0
WRAP_S = 0.127


def decode(rows: ByteArray) -> Samples:
    frames = kvh.decode_frames(rows)
    return Samples(
        number=frames.sequence,
        rate_dps=frames.rotation[:, 2],
        rates_dps=frames.rotation,
        temperature_c=frames.temperature.astype(np.float64),
        status=frames.status,
        valid=frames.status == kvh.GYROS_VALID,
    )


def frames(first: int, count: int, status: int = kvh.GYROS_VALID) -> bytes:
    """Frames whose rate is their true index."""
    rotation = np.zeros((count, 3))
    rotation[:, 2] = np.arange(first, first + count)
    return kvh.encode_frames(rotation, 20, first_sequence=first, status=status)


def empty_queue() -> SampleQueue:
    return SampleQueue(
        kvh.FORMAT, SequenceNumbers(kvh.SEQUENCE_NUMBERS), decode=decode, words=kvh.status_words, rate_hz=RATE_HZ
    )


@pytest.fixture
def queue() -> SampleQueue:
    return empty_queue()


def test_samples_wait_until_they_are_taken_and_their_numbers_do_not_wrap(queue: SampleQueue) -> None:
    data = frames(0, 300)
    for at in range(0, len(data), 1000):
        queue.feed(data[at : at + 1000], unheard_s=0.0)
    assert queue.waiting == 300
    block = queue.take()
    assert block.sequence.tolist() == block.rate_dps.tolist() == list(range(300))
    assert block.valid.all()
    assert (block.gaps, block.faults) == ((), ())
    assert queue.waiting == 0
    queue.feed(frames(300, 2), unheard_s=0.0)
    assert queue.take().sequence.tolist() == [300, 301]


def test_lost_frames_are_a_gap_and_what_follows_keeps_its_index(queue: SampleQueue) -> None:
    queue.feed(frames(0, 3) + frames(103, 2), unheard_s=0.01)
    block = queue.take()
    assert block.sequence.tolist() == [0, 1, 2, 103, 104]
    assert block.gaps == (GyroGap(index=3, lost=100, exact=True),)
    assert block.counts == GyroCounts(samples=5, lost=100, bad_frames=0, junk_bytes=0)


def test_a_gap_between_two_blocks_is_just_before_the_second(queue: SampleQueue) -> None:
    queue.feed(frames(0, 3), unheard_s=0.0)
    queue.take()
    queue.feed(frames(5, 1), unheard_s=0.0)
    assert queue.take().gaps == (GyroGap(index=0, lost=2, exact=True),)


def test_a_damaged_frame_is_counted_and_leaves_a_gap(queue: SampleQueue) -> None:
    data = bytearray(frames(0, 3))
    data[36 + 10] ^= 1
    queue.feed(bytes(data), unheard_s=0.0)
    block = queue.take()
    assert block.sequence.tolist() == [0, 2]
    assert block.gaps == (GyroGap(index=1, lost=1, exact=True),)
    assert block.counts == GyroCounts(samples=2, lost=1, bad_frames=1, junk_bytes=36)


def test_a_gap_after_a_line_that_was_deaf_for_a_wrap_is_not_exact(queue: SampleQueue) -> None:
    queue.feed(frames(0, 3), unheard_s=0.0)
    queue.feed(frames(203, 1), unheard_s=WRAP_S)  # 200 are missing, the numbers say 72
    assert queue.take().gaps == (GyroGap(index=3, lost=72, exact=False),)


def test_a_whole_wrap_lost_by_a_deaf_line_is_told_by_the_bytes_it_tore(queue: SampleQueue) -> None:
    queue.feed(frames(0, 3) + frames(3, 1)[:20], unheard_s=0.0)
    queue.feed(frames(3 + 128, 1), unheard_s=WRAP_S)
    block = queue.take()
    assert block.sequence.tolist() == [0, 1, 2, 3]
    assert block.gaps == (GyroGap(index=3, lost=0, exact=False),)


def test_junk_between_frames_that_follow_each_other_is_counted_and_no_gap(queue: SampleQueue) -> None:
    queue.feed(frames(0, 2) + b"noise" + frames(2, 2), unheard_s=0.0)
    block = queue.take()
    assert block.gaps == ()
    assert block.counts.junk_bytes == queue.junk_bytes == 5


def test_a_deaf_line_that_lost_nothing_leaves_no_gap(queue: SampleQueue) -> None:
    queue.feed(frames(0, 2), unheard_s=0.0)
    queue.feed(frames(2, 2), unheard_s=10.0)
    assert queue.take().gaps == ()


def test_what_was_wrong_is_told_in_words_once(queue: SampleQueue) -> None:
    queue.feed(frames(0, 2, status=0b011) + frames(2, 2, status=0b001) + frames(4, 1), unheard_s=0.0)
    block = queue.take()
    assert block.valid.tolist() == [False] * 4 + [True]
    assert block.status.tolist() == [3, 3, 1, 1, 7]
    assert block.faults == ("gyro Y is not valid", "gyro Z is not valid")


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 126), st.integers(0, 32), st.binary(max_size=40)), max_size=12),
    st.lists(st.integers(1, 300), min_size=1, max_size=5),
)
def test_over_any_line_samples_keep_their_index_and_what_is_missing_is_counted(
    losses: list[tuple[int, int, bytes]], pieces: list[int]
) -> None:
    data, true = frames(0, 1), [0]
    for lost, left_over, junk in losses:  # what is left of the last of the lost frames, then junk
        cut = frames(true[-1] + lost, 1)[:left_over] if lost else b""
        true.append(true[-1] + lost + 1)
        data += cut + junk + frames(true[-1], 1)
    queue, at, blocks = empty_queue(), 0, []
    for turn in range(len(data)):
        size = pieces[turn % len(pieces)]
        queue.feed(data[at : at + size], unheard_s=0.0)
        at += size
        if queue.waiting:
            blocks.append(queue.take())
    sequence = np.concatenate([block.sequence for block in blocks])
    assert sequence.tolist() == np.concatenate([block.rate_dps for block in blocks]).tolist() == true
    counts = blocks[-1].counts
    assert counts.lost == sum(lost for lost, _, _ in losses) == sum(gap.lost for block in blocks for gap in block.gaps)
    assert counts.samples + counts.lost == true[-1] + 1
    assert counts.samples * 36 + counts.junk_bytes == len(data)
