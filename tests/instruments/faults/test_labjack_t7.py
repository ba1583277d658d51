"""The T7 in faults that only it has: of its stream, of its start, of its memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from benchctl_instruments.digitizers.labjack_t7 import LabJackT7
from benchctl_instruments.errors import InstrumentError, LinkError
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.faults.bench import BenchFaults
from benchctl_instruments.simulated.faults.link_faults import LostRequest, Restart, Silence
from benchctl_instruments.simulated.faults.schedule import FaultTable
from benchctl_instruments.simulated.faults.stream_faults import Overrun, StreamCut, StreamGap, StreamJunk
from benchctl_instruments.simulated.labjack_t7 import SimulatedLabJackT7
from tests.instruments.simulated.fake_inputs import FakeInputs

RATE_HZ = 200.0
SCANS_A_PACKET = 10
ENABLE = "^10 13 7e"  # register 4990


@contextmanager
def opened(*faults: FaultTable) -> Iterator[tuple[LabJackT7, FakeInputs, BenchFaults]]:
    inputs = FakeInputs(VirtualClock(), counts_per_s=1000.0)
    bench = BenchFaults(faults, inputs.now)
    twin = SimulatedLabJackT7(inputs)
    bench.befall("digitizer", twin)
    with (
        twin,
        LabJackT7(twin.address, twin.stream_address, clock=inputs.clock, timeout_s=0.5) as t7,
    ):
        yield t7, inputs, bench


def streamed(t7: LabJackT7, inputs: FakeInputs, scans: int) -> tuple[list[int], list[int], float]:
    """Indices and counts of a stream up to a scan, and when it began."""
    start = t7.start_stream(RATE_HZ)
    indices: list[int] = []
    counts: list[int] = []
    while not indices or indices[-1] < scans:
        inputs.clock.sleep(1.0)
        block = t7.read_stream(1, 5.0)
        indices += range(block.first_index, block.first_index + len(block.gyro_v))
        counts += block.encoder_count.tolist()
    t7.stop_stream()
    return indices, counts, start.start_s


@pytest.mark.parametrize(
    ("make", "missing"),
    [
        (lambda nth: StreamGap(on="digitizer_stream", nth=nth), SCANS_A_PACKET),
        (lambda nth: StreamGap(on="digitizer_stream", nth=nth, packets=3), 3 * SCANS_A_PACKET),
        (lambda nth: Overrun(on="digitizer_stream", nth=nth, scans=37), 37),
        (lambda nth: StreamCut(on="digitizer_stream", nth=nth), SCANS_A_PACKET),
        (lambda nth: StreamJunk(on="digitizer_stream", nth=nth), 0),
    ],
)
@pytest.mark.parametrize("nth", [2, 7, 20])
def test_what_the_stream_loses_is_a_gap_in_its_true_place(
    make: Callable[[int], FaultTable], missing: int, nth: int
) -> None:
    with opened(make(nth)) as (t7, inputs, bench):
        indices, counts, start_s = streamed(t7, inputs, 600)
    (fired,) = bench.fired
    assert fired.operation == f"packet {nth - 1}"
    assert counts == inputs.counts(start_s + np.array(indices) / RATE_HZ).tolist()
    jumps = np.flatnonzero(np.diff(indices) > 1)
    assert len(jumps) == bool(missing)
    if missing:
        assert indices[jumps[0]] == (nth - 1) * SCANS_A_PACKET - 1
        assert indices[jumps[0] + 1] - indices[jumps[0]] - 1 == missing


def test_a_stream_that_breaks_before_its_first_packet_has_no_known_times_and_is_given_up() -> None:
    with opened(StreamCut(on="digitizer_stream", nth=1)) as (t7, inputs, _):
        with pytest.raises(LinkError, match="broke before its first packet, so the times of all others are not known"):
            streamed(t7, inputs, 100)
        t7.stop_stream()
        indices, _, _ = streamed(t7, inputs, 100)
        assert indices[0] == 0


@pytest.mark.parametrize("make", [Silence, LostRequest])
def test_a_start_whose_answer_is_lost_is_found_out_and_not_made_twice(make: Callable[..., FaultTable]) -> None:
    with opened(make(on="digitizer", pattern=ENABLE, nth=2)) as (t7, inputs, bench):
        t7.start_stream(RATE_HZ)
        t7.stop_stream()
        indices, counts, start_s = streamed(t7, inputs, 100)
    assert len(bench.fired) == 1
    assert indices == list(range(len(indices)))
    assert counts == inputs.counts(start_s + np.array(indices) / RATE_HZ).tolist()


@pytest.mark.parametrize("act", [lambda t7: t7.read_once(), lambda t7: t7.start_stream(RATE_HZ)])
def test_a_t7_that_has_restarted_says_so_instead_of_counting_from_nothing(act: Callable[[LabJackT7], object]) -> None:
    restarts = Restart(on="digitizer", pattern="^03 ab e0", nth=4, for_s=0.05)  # as it is asked whether it counts
    with opened(restarts) as (t7, _, _):
        act(t7)
        t7.stop_stream()
        with pytest.raises(InstrumentError, match="it has restarted, and the count is lost"):
            act(t7)
