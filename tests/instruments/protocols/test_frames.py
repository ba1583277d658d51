from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchctl_instruments.protocols.frames import FrameFormat, FrameReader, crc32_mpeg2

LONG_HEADER = FrameFormat(name="long header", header=b"\xfe\x81\xff\x55", crc_at=32)
ONE_BYTE = FrameFormat(name="one byte", header=b"\xa7", crc_at=55, padding=1)
SHORT = FrameFormat(name="short", header=b"\xbc", crc_at=22, padding=2)
WITH_TAIL = FrameFormat(name="with tail", header=b"\xbd", crc_at=22, padding=2, tail=b"\r\n")
SETS = ((LONG_HEADER,), (ONE_BYTE,), (ONE_BYTE, SHORT, WITH_TAIL))


def frame(kind: FrameFormat, contents: bytes = b"") -> bytes:
    """A good frame whose contents begin so, and are then the header over and over."""
    body = (kind.header + contents).ljust(kind.crc_at, kind.header[-1:])[: kind.crc_at]
    return body + crc32_mpeg2(body + bytes(kind.padding)).to_bytes(4, "big") + kind.tail


def read(kinds: tuple[FrameFormat, ...], data: bytes, cuts: list[int]) -> tuple[list[tuple[int, bytes]], FrameReader]:
    """Each frame with its place, from data cut into pieces of these sizes over and over."""
    reader, found, at, turn = FrameReader(kinds), [], 0, 0
    while at < len(data):
        size = cuts[turn % len(cuts)] if cuts else len(data)
        for run in reader.feed(data[at : at + size]):
            rows = [row.tobytes() for row in run.rows]
            assert all(len(row) == run.format.length for row in rows)
            found += list(zip(run.first_byte.tolist(), rows, strict=True))
        at, turn = at + size, turn + 1
    return found, reader


@dataclass(frozen=True)
class Stream:
    """A stream and the frames in it that nothing has touched, with their places."""

    kinds: tuple[FrameFormat, ...]
    data: bytes
    good: list[tuple[int, bytes]]


@st.composite
def streams(draw: st.DrawFn) -> Stream:
    """Good frames, junk (also headers and halves of them), frames without their end or beginning, flipped bits.

    A mark in every frame sees to it that two halves never make a whole one.
    """
    kinds = draw(st.sampled_from(SETS))
    data, good = b"", []
    for what in draw(
        st.lists(st.sampled_from(["good", "good", "good", "junk", "cut", "torn", "flipped"]), max_size=12)
    ):
        kind = draw(st.sampled_from(kinds))
        mark = crc32_mpeg2(len(data).to_bytes(4, "big")).to_bytes(4, "big")
        whole = frame(kind, mark + draw(st.binary(max_size=kind.crc_at)))
        if what == "good":
            good.append((len(data), whole))
            data += whole
        elif what == "junk":
            headers = st.sampled_from([kind.header, kind.header[:2], kind.header * 3])
            data += draw(st.binary(max_size=90) | headers)
        elif what == "cut":
            data += whole[: draw(st.integers(1, kind.crc_at))]
        elif what == "torn":
            data += whole[draw(st.integers(len(kind.header + mark), kind.length - 1)) :]
        else:
            at, bit = draw(st.integers(0, kind.length - 1)), draw(st.integers(0, 7))
            data += whole[:at] + bytes([whole[at] ^ 1 << bit]) + whole[at + 1 :]
    return Stream(kinds, data, good)


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(streams(), st.lists(st.integers(1, 200), max_size=6))
def test_every_untouched_frame_is_kept_and_no_other_whatever_the_pieces(stream: Stream, cuts: list[int]) -> None:
    longest = max(kind.length for kind in stream.kinds)
    # what follows decides what the last bytes were
    found, reader = read(stream.kinds, stream.data + bytes(longest), cuts)
    assert found == stream.good
    kept = sum(len(row) for _, row in found)
    assert reader.kept == len(found)
    assert kept + reader.junk_bytes + reader.waiting == len(stream.data) + longest
    assert reader.waiting < longest


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(streams(), st.lists(st.integers(1, 200), min_size=1, max_size=6))
def test_what_is_counted_does_not_depend_on_the_pieces(stream: Stream, cuts: list[int]) -> None:
    found, in_pieces = read(stream.kinds, stream.data, cuts)
    expected, at_once = read(stream.kinds, stream.data, [])
    assert found == expected
    for count in ("kept", "bad_frames", "junk_bytes", "waiting"):
        assert getattr(in_pieces, count) == getattr(at_once, count), count


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(streams())
def test_a_good_frame_comes_with_its_last_byte_where_all_are_of_one_length(stream: Stream) -> None:
    kind, data = stream.kinds[0], frame(stream.kinds[0], b"\x01")
    reader = FrameReader([kind])
    reader.feed(stream.data)
    before = reader.kept
    reader.feed(data[:-1])
    between = reader.kept
    reader.feed(data[-1:])
    assert (between, reader.kept) == (between, between + 1)
    assert before <= between


@pytest.mark.parametrize("kind", [LONG_HEADER, ONE_BYTE, SHORT, WITH_TAIL])
def test_each_flipped_bit_costs_its_frame_and_no_other(kind: FrameFormat) -> None:
    # contents without headers, so that every damaged frame but one without its header counts as bad
    body = kind.header + bytes(kind.crc_at - len(kind.header))
    good = body + crc32_mpeg2(body + bytes(kind.padding)).to_bytes(4, "big") + kind.tail
    damaged = [
        good[:at] + bytes([good[at] ^ 1 << bit]) + good[at + 1 :] for at in range(kind.length) for bit in range(8)
    ]
    found, reader = read((kind,), good + b"".join(bad + good for bad in damaged), [4096])
    assert [row for _, row in found] == [good] * (1 + len(damaged))
    assert reader.bad_frames == len(damaged) - 8 * len(kind.header)
    assert reader.junk_bytes == kind.length * len(damaged)


def test_a_cut_frame_is_one_bad_frame_and_its_bytes_are_junk() -> None:
    good = frame(LONG_HEADER, bytes(28))
    _, reader = read((LONG_HEADER,), good + good[:20] + good + good, [7])
    assert (reader.kept, reader.bad_frames, reader.junk_bytes, reader.waiting) == (3, 1, 20, 0)


def test_a_good_frame_in_a_bad_ones_span_ends_that_span() -> None:
    good = frame(LONG_HEADER, bytes(28))
    _, reader = read((LONG_HEADER,), good[:10] + good + good[:10] + good, [])
    assert (reader.kept, reader.bad_frames, reader.junk_bytes) == (2, 2, 20)


def test_of_two_frames_that_overlap_the_first_is_taken() -> None:
    inner = frame(SHORT, bytes(21))
    outer = frame(ONE_BYTE, b"\x01" + inner)
    for cuts in ([], [1], [30]):
        found, _ = read((SHORT, ONE_BYTE), outer + inner, cuts)
        assert found == [(0, outer), (len(outer), inner)]


def test_frames_of_several_formats_come_in_their_order() -> None:
    data = frame(ONE_BYTE) + frame(SHORT) + frame(SHORT) + frame(ONE_BYTE)
    runs = FrameReader([SHORT, ONE_BYTE]).feed(data + bytes(60))
    assert [(run.format.name, len(run.rows)) for run in runs] == [("one byte", 1), ("short", 2), ("one byte", 1)]


def test_sealing_makes_what_is_read_back() -> None:
    for kind in (LONG_HEADER, ONE_BYTE, WITH_TAIL):
        contents = np.zeros((3, kind.crc_at), np.uint8)
        contents[:, : len(kind.header)] = list(kind.header)
        contents[:, -1] = [1, 2, 3]
        sealed = kind.sealed(contents)
        assert len(sealed) == 3 * kind.length
        (run,) = FrameReader([kind]).feed(sealed)
        assert (run.rows[:, : kind.crc_at] == contents).all()


def test_no_bytes_bring_no_frames() -> None:
    reader = FrameReader([LONG_HEADER])
    assert reader.feed(b"") == []
    assert (reader.kept, reader.waiting, reader.junk_bytes) == (0, 0, 0)


@pytest.mark.parametrize("kind", [LONG_HEADER, ONE_BYTE])
def test_endless_junk_is_not_kept(kind: FrameFormat) -> None:
    reader = FrameReader([kind])
    for _ in range(20):
        reader.feed(kind.header * 1000)
        assert reader.waiting < kind.length
    assert reader.kept == 0


@pytest.mark.parametrize("kind", [LONG_HEADER, ONE_BYTE])
def test_a_second_at_four_megabits_costs_a_quarter_of_a_processor_at_most(kind: FrameFormat) -> None:
    generator = np.random.default_rng(1)
    contents = generator.integers(0, 256, (400_000 // kind.length, kind.crc_at), dtype=np.uint8)
    contents[:, : len(kind.header)] = list(kind.header)
    data = kind.sealed(contents)
    reader = FrameReader([kind])
    started_s = time.process_time()
    for at in range(0, len(data), 4096):
        reader.feed(data[at : at + 4096])
    assert time.process_time() - started_s < 0.25
    assert reader.kept == len(contents)
