from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl_instruments.digitizers.t7_registers import AinCalibration, ScanQueue
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.interfaces import ScanBlock
from benchctl_instruments.protocols.t7_stream import encode_packets

IDEAL = AinCalibration(positive_slope=20.0 / 65536, negative_slope=-20.0 / 65536, centre=32768.0)
NOMINAL = AinCalibration(positive_slope=3.1580578e-4, negative_slope=-3.15805800e-4, centre=33523.0)
"""LabJack's nominal constants of the ±10 V range, from its datasheet."""


def streamed(counts: list[int], *, first_transaction: int = 0) -> bytes:
    """Scans with these counts, a packet each, at 0 V."""
    raw = np.array(counts, np.int64) & 0xFFFFFFFF
    columns = (raw & 0xFFFF, raw >> 16, np.full(len(raw), 0x8000), np.full(len(raw), 0x8000))
    return encode_packets(np.stack(columns, axis=1), first_transaction=first_transaction)


def taken(queue: ScanQueue, data: bytes) -> ScanBlock:
    queue.feed(data)
    return queue.take()


@given(st.lists(st.integers(-(2**31) + 1, 2**31 - 1), min_size=1, max_size=30), st.integers(-(2**31), 2**31 - 1))
def test_counts_are_signed_and_go_on_where_their_32_bits_wrap(steps: list[int], start: int) -> None:
    counts = [start, *(start + sum(steps[: place + 1]) for place in range(len(steps)))]
    queue = ScanQueue(IDEAL)
    cut = len(counts) // 2 + 1
    found = [*taken(queue, streamed(counts[:cut])).encoder_count]
    if counts[cut:]:
        found += [*taken(queue, streamed(counts[cut:], first_transaction=cut)).encoder_count]
    assert found == counts


def test_volts_follow_the_nominal_range_where_the_calibration_is_ideal() -> None:
    codes = np.array([0, 1, 0x7FFF, 0x8000, 0xFFFE], np.uint16)
    assert IDEAL.volts(codes) == pytest.approx(codes * 20.0 / 65536 - 10.0, abs=1e-12)


def test_volts_follow_labjacks_constants_on_both_sides_of_the_centre() -> None:
    volts = NOMINAL.volts(np.array([0, 33523, 65534], np.uint16))
    assert volts == pytest.approx([-10.586756, 0.0, 10.109260], abs=2e-5)


def test_labjacks_nominal_constants_pass_the_check_and_those_of_another_range_do_not() -> None:
    NOMINAL.check(10.0)
    with pytest.raises(InstrumentError, match="±1 V range"):
        NOMINAL.check(1.0)


@pytest.mark.parametrize("slope", [float("nan"), 0.0, -3.05e-4])
def test_constants_that_make_no_sense_are_refused(slope: float) -> None:
    with pytest.raises(InstrumentError, match="expected the calibration"):
        AinCalibration(positive_slope=slope, negative_slope=-3.05e-4, centre=32768.0).check(10.0)


def test_a_gap_ends_a_block_and_what_follows_comes_with_the_next() -> None:
    queue = ScanQueue(IDEAL)
    queue.feed(streamed([1, 2, 3]) + streamed([10, 11], first_transaction=7))
    assert queue.waiting == 3
    assert queue.ready(100)
    first, then = queue.take(), queue.take()
    assert (first.first_index, first.encoder_count.tolist()) == (0, [1, 2, 3])
    assert (then.first_index, then.encoder_count.tolist()) == (7, [10, 11])
    assert queue.waiting == 0


def test_runs_without_a_gap_make_one_block() -> None:
    queue = ScanQueue(IDEAL)
    queue.feed(streamed([1, 2]))
    assert not queue.ready(3)
    queue.feed(streamed([3], first_transaction=2))
    assert queue.ready(3)
    assert queue.take().encoder_count.tolist() == [1, 2, 3]
