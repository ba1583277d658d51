from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.world import World
from tests.instruments.simulated.quiet import quiet


def test_a_bench_starts_at_rest_in_the_rooms_temperature_with_everything_off() -> None:
    world = World(VirtualClock())
    assert world.settings == WorldSettings()
    assert world.table.motion().rate_dps == 0.0
    assert world.chamber.running() is False
    assert world.chamber.air_c() == world.settings.room_c
    counts, volts, thermistor = world.inputs.sample(0.0, 0.002, 1)
    assert counts.shape == volts.shape == thermistor.shape == (1,)


def test_a_streaming_thread_sees_the_same_volts_however_it_is_scheduled() -> None:
    clock = VirtualClock()
    world = World(clock, quiet())
    world.table.close_loop()
    world.inputs.hold_history(0.0)
    scans, rate_hz = 20_000, 500.0
    blocks: list[np.ndarray[tuple[int], np.dtype[np.float64]]] = []
    trouble: list[BaseException] = []

    def stream() -> None:
        try:
            taken = 0
            while taken < scans:
                if not world.inputs.wait_until(taken / rate_hz, 10.0):
                    return
                due = min(scans, int(world.inputs.now() * rate_hz + 1e-6) + 1) - taken
                blocks.append(world.inputs.sample(0.0, 1.0 / rate_hz, due, start=taken)[1])
                taken += due
        except BaseException as error:
            trouble.append(error)

    streaming = threading.Thread(target=stream)
    streaming.start()
    for k in range(200):
        world.table.demand_rate(30.0 * np.sin(k))
        world.chamber.set_setpoint(20.0 + k % 5)
        world.table.motion()
        clock.sleep(0.2)
    streaming.join(timeout=30.0)
    assert trouble == []
    alone = World(VirtualClock(), quiet())
    alone.table.close_loop()
    alone.inputs.hold_history(0.0)
    for k in range(200):
        alone.table.demand_rate(30.0 * np.sin(k))
        alone.chamber.set_setpoint(20.0 + k % 5)
        alone.clock.sleep(0.2)
    expected = alone.inputs.sample(0.0, 1.0 / rate_hz, scans)[1]
    np.testing.assert_allclose(np.concatenate(blocks), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("begin_s", [0.1, 100_000.123])
def test_a_stream_of_a_turning_table_is_the_same_to_the_last_bit_whatever_the_pieces_it_is_taken_in(
    begin_s: float,
) -> None:
    # of instants that differ in their rounding alone, one in a million falls on the other side of an encoder's edge
    scans, rate_hz = 20_000, 500.0
    found = []
    for piece in (scans, 2500, 7):
        clock = VirtualClock()
        world = World(clock)
        clock.sleep(begin_s)
        world.table.close_loop()
        world.table.demand_rate(133.7)
        first_s = clock.now()
        world.inputs.hold_history(first_s)
        clock.sleep(scans / rate_hz)
        starts = range(0, scans, piece)
        taken = [
            world.inputs.sample(first_s, 1.0 / rate_hz, min(piece, scans - start), start=start) for start in starts
        ]
        found.append([np.concatenate(columns) for columns in zip(*taken, strict=True)])
    for other in found[1:]:
        for column, same in zip(found[0], other, strict=True):
            np.testing.assert_array_equal(column, same)


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["sine", "rate"])
def test_a_million_scans_of_motion_cost_seconds(motion: str) -> None:
    # six million scans at 500 Hz in 12 s of one core
    clock = VirtualClock()
    world = World(clock)
    world.table.close_loop()
    if motion == "sine":
        world.table.demand_sine(48.0, 0.5, 0.0, 50.0)
    else:
        world.table.demand_rate(100.0)
    world.inputs.hold_history(0.0)
    clock.sleep(2000.0)
    before = time.process_time()
    world.inputs.sample(0.0, 0.002, 1_000_000)
    assert time.process_time() - before < 2.0
