from __future__ import annotations

import threading
import time

import pytest

from benchctl_instruments.errors import UsageError
from benchctl_instruments.interfaces import Clock
from benchctl_instruments.simulated.clock import ScaledClock, VirtualClock


def chunk(clock: Clock) -> float:
    return clock.chunk_s


def test_virtual_time_stands_still_until_somebody_sleeps() -> None:
    clock = VirtualClock()
    before = time.monotonic()
    clock.sleep(3600.0)
    clock.sleep(0.5)
    assert clock.now() == 3600.5
    assert time.monotonic() - before < 1.0
    assert chunk(clock) == 5.0


def test_a_jump_wakes_who_waits_for_an_instant_in_it() -> None:
    clock = VirtualClock()
    came: list[bool] = []
    waiting = threading.Thread(target=lambda: came.append(clock.wait_until(10.0, timeout_s=20.0)))
    waiting.start()
    clock.sleep(9.0)
    assert came == []
    clock.sleep(2.0)
    waiting.join(timeout=5.0)
    assert came == [True]


def test_waiting_for_a_virtual_instant_that_does_not_come_ends_by_the_wall() -> None:
    clock = VirtualClock()
    before = time.monotonic()
    assert clock.wait_until(1.0, timeout_s=0.05) is False
    assert 0.04 < time.monotonic() - before < 2.0
    assert clock.wait_until(0.0, timeout_s=0.0) is True


def test_scaled_time_runs_at_a_multiple_of_the_walls() -> None:
    clock = ScaledClock(100.0)
    before, bench = time.monotonic(), clock.now()
    clock.sleep(5.0)
    wall = time.monotonic() - before
    assert 0.05 <= wall < 1.0
    assert clock.now() - bench == pytest.approx(100.0 * wall, rel=0.2)
    assert chunk(clock) == 50.0


def test_a_scaled_instant_is_waited_for_or_given_up() -> None:
    clock = ScaledClock(100.0)
    assert clock.wait_until(2.0, timeout_s=5.0) is True
    assert clock.now() >= 2.0
    assert clock.wait_until(clock.now() + 1000.0, timeout_s=0.02) is False


@pytest.mark.parametrize("clock", [VirtualClock(), ScaledClock()])
@pytest.mark.parametrize("seconds", [-1.0, float("nan"), float("inf")])
def test_time_cannot_be_made_to_pass_backwards_or_for_ever(clock: VirtualClock | ScaledClock, seconds: float) -> None:
    with pytest.raises(UsageError, match="bench time"):
        clock.sleep(seconds)


@pytest.mark.parametrize("factor", [0.0, -2.0, float("inf")])
def test_a_clock_cannot_stand_still_or_run_backwards(factor: float) -> None:
    with pytest.raises(UsageError, match="factor above 0"):
        ScaledClock(factor)
