"""The machines of the simulated bench with faults: what they show, and what they truly do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.faults.bench import BenchFaults
from benchctl_instruments.simulated.faults.machines import (
    ClockDrift,
    EncoderJump,
    OverRange,
    StallsShort,
    StuckReading,
    VelocityTrip,
)
from benchctl_instruments.simulated.faults.schedule import FaultTable
from benchctl_instruments.simulated.machines import AnalogInputs, ChamberMachine
from benchctl_instruments.simulated.world import World
from tests.instruments.chamber_machine import FakeChamber
from tests.instruments.simulated.fake_inputs import FakeInputs
from tests.instruments.table_machine import InstantTable


def faulty_chamber(
    chamber: ChamberMachine, clock: VirtualClock, *faults: FaultTable
) -> tuple[ChamberMachine, BenchFaults]:
    bench = BenchFaults(faults, clock.now)
    return bench.chamber(chamber), bench


def test_a_machine_that_no_fault_concerns_is_left_as_it_is() -> None:
    bench = BenchFaults([StuckReading(on="digitizer")], lambda: 0.0)
    chamber, table = FakeChamber(), InstantTable()
    assert bench.chamber(chamber) is chamber
    assert bench.table(table) is table


def test_air_that_is_stuck_reads_what_it_was_while_the_chamber_goes_on() -> None:
    clock, truth = VirtualClock(), FakeChamber()
    chamber, bench = faulty_chamber(truth, clock, StuckReading(on="chamber", from_s=10.0, to_s=20.0, for_s=15.0))
    shown = []
    for air_c in (20.0, 21.0, 22.0, 23.0, 24.0):
        truth.air = air_c
        shown.append(chamber.air_c())
        clock.sleep(8.0)
    assert shown == [20.0, 21.0, 21.0, 21.0, 24.0]  # at 0, 8, 16, 24 and 32 s
    assert [(fired.bench_s, fired.operation) for fired in bench.fired] == [(16.0, "air")]


def test_a_chamber_that_stalls_stays_short_on_the_side_from_which_it_comes_and_shows_what_was_demanded() -> None:
    clock = VirtualClock()
    world = World(clock)
    chamber, bench = faulty_chamber(world.chamber, clock, StallsShort(on="chamber", short_c=4.0, nth=1, for_s=20_000.0))
    chamber.run(True)
    for setpoint_c, arrives_c in ((50.0, 46.0), (-10.0, -6.0), (20.0, 20.0)):
        chamber.set_setpoint(setpoint_c)
        clock.sleep(4 * 3600.0)
        assert chamber.setpoint_c() == setpoint_c
        assert chamber.air_c() == pytest.approx(arrives_c, abs=0.01)
    assert [fired.operation for fired in bench.fired] == ["set point 50"]


def test_an_over_range_sensor_reads_what_it_is_told_for_its_time() -> None:
    clock, truth = VirtualClock(), FakeChamber()
    chamber, _ = faulty_chamber(truth, clock, OverRange(on="chamber", nth=2, for_s=5.0))
    shown = []
    for _ in range(4):
        shown.append(chamber.air_c())
        clock.sleep(3.0)
    assert shown == [23.0, 1000.0, 1000.0, 23.0]


def test_a_tachometer_reads_too_much_while_the_table_turns_as_it_did() -> None:
    truth = InstantTable()
    table = BenchFaults([VelocityTrip(on="rate_table", nth=2, for_s=1.0, times=1)], lambda: 7.0).table(truth)
    table.demand_rate(30.0)
    assert [table.motion().rate_dps for _ in range(2)] == [30.0, 1e4]
    assert truth.motion().rate_dps == 30.0


def sampled(
    inputs: AnalogInputs, clock: VirtualClock, pieces: Sequence[int]
) -> tuple[list[int], list[float], list[float]]:
    """Scans at 100 Hz from 0 s on, taken in blocks of these sizes."""
    clock.sleep(sum(pieces) / 100.0)
    blocks, first = [], 0
    for scans in pieces:
        blocks.append(inputs.sample(first / 100.0, 0.01, scans))
        first += scans
    counts, gyro_v, thermistor_v = (np.concatenate(column).round(9).tolist() for column in zip(*blocks, strict=True))
    return counts, gyro_v, thermistor_v


@pytest.mark.parametrize(
    "fault",
    [
        EncoderJump(on="digitizer", from_s=2.345, counts=777),
        OverRange(on="digitizer", from_s=2.345, terminal="gyro"),
        StuckReading(on="digitizer", from_s=2.345),
    ],
)
def test_a_fault_of_the_terminals_begins_with_its_scan_however_many_are_taken_at_once(fault: FaultTable) -> None:
    found = []
    for pieces in ([500], [100] * 5, [7, 230, 1, 262], [234, 1, 265]):
        clock = VirtualClock()
        found.append(sampled(BenchFaults([fault], clock.now).inputs(FakeInputs(clock)), clock, pieces))
    assert all(samples == found[0] for samples in found[1:])
    true = sampled(FakeInputs(clock := VirtualClock()), clock, [500])
    for column, true_column in zip(found[0], true, strict=True):
        assert column[:235] == true_column[:235]
    assert found[0] != true


def test_an_encoder_jumps_once_and_goes_on_from_there() -> None:
    clock = VirtualClock()
    jump = EncoderJump(on="digitizer", from_s=1.0, counts=777)
    counts, _, _ = sampled(BenchFaults([jump], clock.now).inputs(FakeInputs(clock)), clock, [300])
    true, _, _ = sampled(FakeInputs(other := VirtualClock()), other, [300])
    assert [shown - was for shown, was in zip(counts, true, strict=True)] == [0] * 100 + [777] * 200


def test_a_crystal_that_is_fast_by_a_thousand_ppm_states_a_thousandth_more() -> None:
    clock = VirtualClock()
    truth = FakeInputs(clock, counts_per_s=1000.0)
    inputs = BenchFaults([ClockDrift(on="digitizer", ppm=1000.0)], clock.now).inputs(truth)
    clock.sleep(100.0)
    assert inputs.now() == pytest.approx(100.1)
    assert inputs.wait_until(100.05, 0.0)
    assert not inputs.wait_until(100.2, 0.0)
    counts, _, _ = inputs.sample(50.05, 0.01001, 2)
    assert counts.tolist() == [50_000, 50_010]
