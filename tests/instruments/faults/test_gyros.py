"""The digital gyros in the faults of their lines: no sample is wrong, and what is missing is told and has its place.

| fault              | outcome                                                              |
|--------------------|----------------------------------------------------------------------|
| junk before, after | recovered; the junk is counted                                       |
| a frame lost, cut, |                                                                      |
| spoilt, junk in it | recovered, a gap of one sample is told at its place                  |
| silence            | stopped: `LinkError` says how many samples came                      |
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, get_args

import numpy as np
import pytest

from benchctl_instruments.errors import LinkError
from benchctl_instruments.gyros.kvh_dsp1760 import KvhDsp1760
from benchctl_instruments.gyros.sensonor_stim300 import SensonorStim300
from benchctl_instruments.interfaces import Gyro
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.faults.schedule import Fired
from benchctl_instruments.simulated.faults.stream_faults import FrameFault, FrameFaults, FrameKind
from benchctl_instruments.simulated.kvh_dsp1760 import SimulatedKvhDsp1760
from benchctl_instruments.simulated.sensonor_stim300 import SimulatedStim300
from tests.instruments.gyros.gyro_inputs import SETTINGS, RampInputs

RATE_HZ = 250.0
HIT = 120  # the frame that is befallen
GYROS = {
    "kvh_dsp1760": (SimulatedKvhDsp1760, KvhDsp1760),
    "sensonor_stim300": (partial(SimulatedStim300, rate_hz=RATE_HZ), SensonorStim300),
}
WITHOUT_LOSS = ("frame_junk_before", "frame_junk_after")


@contextmanager
def streaming(model: str, kind: FrameKind) -> Iterator[tuple[Gyro, VirtualClock, list[Fired]]]:
    """A gyro, one frame of whose stream is befallen."""
    clock = VirtualClock()
    log: list[Fired] = []
    make_twin: Callable[..., Any]
    make_driver: Callable[..., Any]
    make_twin, make_driver = GYROS[model]
    with make_twin(RampInputs(clock, rate_dps=-30.0, ramp_dps2=10.0), SETTINGS, over_tcp=True) as twin:
        twin.line.disturb = FrameFaults(
            twin.frame_bytes, [FrameFault(on="gyro", kind=kind, nth=HIT + 1)], batch_s=lambda: twin.batch_s, log=log
        )
        clock.sleep(0.1)  # one of them sends all the time, and is known by what it sends
        with make_driver(twin.address, clock=clock, timeout_s=5.0) as gyro:
            yield gyro, clock, log


@pytest.mark.parametrize("model", GYROS)
@pytest.mark.parametrize("kind", [kind for kind in get_args(FrameKind) if kind != "frames_end"])
def test_no_sample_is_wrong_and_what_is_missing_is_told_at_its_place(model: str, kind: FrameKind) -> None:
    with streaming(model, kind) as (gyro, clock, log):
        rate_hz = gyro.start_stream(RATE_HZ)
        clock.sleep(1.0)
        lost = 0 if kind in WITHOUT_LOSS else 1
        block = gyro.read_stream(200, 5.0)
        gyro.stop_stream()
    assert len(log) == 1
    assert sum(gap.lost for gap in block.gaps) == lost == block.counts.lost
    steps = np.diff(block.sequence)
    assert sorted(set(steps.tolist())) == ([1, 2] if lost else [1])
    slope = np.polyfit(block.sequence / rate_hz, block.rate_dps, 1)
    assert slope[0] == pytest.approx(10.0, rel=1e-3)
    assert np.abs(block.rate_dps - np.polyval(slope, block.sequence / rate_hz)).max() < 0.01
    if lost:
        assert [gap.index for gap in block.gaps] == [int(np.argmax(steps)) + 1]


@pytest.mark.parametrize("model", GYROS)
def test_a_gyro_that_falls_silent_is_a_link_error_that_says_how_many_came(model: str) -> None:
    with streaming(model, "frames_end") as (gyro, clock, _):
        gyro.start_stream(RATE_HZ)
        clock.sleep(1.0)
        with pytest.raises(LinkError, match=r"expected 200 samples within 0.3 s, \d+ came"):
            gyro.read_stream(200, 0.3)
