"""The thread that reads a digital gyro, over a real line."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from benchctl.campaign import frames
from benchctl.campaign.frames import FramePump, Heard
from benchctl_instruments.errors import UsageError
from benchctl_instruments.gyros.kvh_dsp1760 import KvhDsp1760
from benchctl_instruments.interfaces import GyroBlock
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.kvh_dsp1760 import SimulatedKvhDsp1760
from tests.instruments.gyros.gyro_inputs import SETTINGS, RampInputs

RATE_HZ = 100.0


@contextmanager
def pumped() -> Iterator[tuple[FramePump, VirtualClock, KvhDsp1760]]:
    clock = VirtualClock()
    with (
        SimulatedKvhDsp1760(RampInputs(clock, rate_dps=5.0), SETTINGS, over_tcp=True) as twin,
        KvhDsp1760(twin.address, clock=clock, timeout_s=5.0) as gyro,
    ):
        pump = FramePump(gyro, clock, RATE_HZ)
        try:
            yield pump, clock, gyro
        finally:
            pump.stop()


def samples(pump: FramePump, wanted: int) -> list[Heard]:
    heard: list[Heard] = []
    give_up_s = time.monotonic() + 10.0
    while sum(one.block.sequence.size for one in heard) < wanted:
        assert time.monotonic() < give_up_s, "they did not come"
        heard += pump.take(0.1)
    return heard


def test_blocks_come_with_the_clock_at_which_they_had_come() -> None:
    with pumped() as (pump, clock, _):
        assert (pump.began_s, pump.rate_hz) == (0.0, RATE_HZ)
        clock.sleep(1.0)
        heard = samples(pump, 99)
        assert {one.stamp_s for one in heard} == {1.0}
        assert [number for one in heard for number in one.block.sequence.tolist()] == list(range(100))
        assert pump.take(0.0) == []


def test_a_line_that_is_silent_ends_nothing_and_says_why() -> None:
    with pumped() as (pump, clock, _):
        time.sleep(2.0 * frames.LOOK_S)
        assert pump.take(0.05) == []
        assert "nothing came" in pump.silence
        clock.sleep(0.5)
        assert samples(pump, 40)


def test_where_nobody_takes_blocks_the_line_is_not_read_and_the_numbers_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frames, "MOST_BLOCKS", 2)
    with pumped() as (pump, clock, _):
        for _ in range(8):
            clock.sleep(0.1)
            time.sleep(0.02)
        heard = samples(pump, 75)
        numbers = [number for one in heard for number in one.block.sequence.tolist()]
        assert numbers == list(range(len(numbers)))


def test_what_is_no_silence_is_raised_where_blocks_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(samples: int, timeout_s: float) -> GyroBlock:
        raise UsageError("not so")

    with pumped() as (pump, clock, gyro):
        monkeypatch.setattr(gyro, "read_stream", refuse)
        clock.sleep(0.1)
        with pytest.raises(UsageError, match="not so"):
            samples(pump, 1000)


def test_stopping_twice_does_no_harm_and_leaves_the_gyro_to_its_owner() -> None:
    with pumped() as (pump, _, gyro):
        pump.stop()
        pump.stop()
        gyro.stop_stream()
        assert gyro.start_stream(RATE_HZ) == RATE_HZ
