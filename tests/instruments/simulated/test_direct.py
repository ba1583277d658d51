from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Chamber, Digitizer, RateTable, TableLimits, TableState
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.direct import DirectChamber, DirectDigitizer, DirectRateTable
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.world import World
from tests.instruments.simulated.quiet import quiet


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def world(clock: VirtualClock) -> World:
    return World(clock, quiet())


@pytest.fixture
def table(world: World) -> Iterator[RateTable]:
    with DirectRateTable(world) as table:
        table.enable()
        yield table


@pytest.fixture
def digitizer(clock: VirtualClock, world: World) -> Iterator[Digitizer]:
    clock.sleep(100.0)
    with DirectDigitizer(world) as digitizer:
        yield digitizer


def test_the_table_turns_stops_and_says_so(clock: VirtualClock, table: RateTable) -> None:
    assert table.state() is TableState.AT_REST
    table.go_to_rate(-50.0)
    clock.sleep(3.0)
    assert table.state() is TableState.MOVING
    assert table.read().rate_dps == pytest.approx(-50.0)
    assert 0.0 <= table.read().angle_deg < 360.0
    table.stop()
    clock.sleep(3.0)
    assert table.state() is TableState.AT_REST
    table.disable()
    assert table.state() is TableState.DISABLED


def test_the_table_goes_the_short_way_round(clock: VirtualClock, world: World, table: RateTable) -> None:
    table.go_to_angle(350.0)
    clock.sleep(5.0)
    assert world.table.motion().angle_deg == pytest.approx(-10.0)
    assert table.read().angle_deg == pytest.approx(350.0)


def test_an_oscillation_has_the_peak_rate_asked_for_and_never_counts_as_rest(
    clock: VirtualClock, table: RateTable
) -> None:
    table.oscillate(100.0, 0.5)
    clock.sleep(8.0)
    peak = 0.0
    for _ in range(400):
        clock.sleep(0.005)
        assert table.state() is TableState.MOVING
        peak = max(peak, abs(table.read().rate_dps))
    # the servo's gain at 0.5 Hz is above one by (f/fₙ)²
    assert peak == pytest.approx(100.0, rel=2e-3)


def test_a_table_refuses_what_it_cannot_do(clock: VirtualClock, table: RateTable) -> None:
    table.set_limits(TableLimits(rate_dps=100.0, acceleration_dps2=500.0))
    with pytest.raises(InstrumentError, match="a rate of 101 deg/s, its limit is 100 deg/s"):
        table.go_to_rate(-101.0)
    with pytest.raises(InstrumentError, match="an acceleration of"):
        table.oscillate(90.0, 1.0)
    with pytest.raises(UsageError, match="above 0"):
        table.oscillate(90.0, 0.0)
    with pytest.raises(InstrumentError, match="a rate of nan deg/s"):
        table.go_to_rate(math.nan)
    with pytest.raises(UsageError, match="an angle of nan deg"):
        table.go_to_angle(math.nan)
    table.go_to_rate(10.0)
    clock.sleep(1.0)
    with pytest.raises(InstrumentError, match="stop it first"):
        table.disable()


def test_a_disabled_table_does_not_move(world: World) -> None:
    table = DirectRateTable(world)
    with pytest.raises(InstrumentError, match="enable it first"):
        table.go_to_rate(1.0)
    with pytest.raises(InstrumentError, match="enable it first"):
        table.go_to_angle(1.0)
    with pytest.raises(InstrumentError, match="enable it first"):
        table.oscillate(1.0, 1.0)


def test_the_chamber_goes_where_its_limits_let_it(clock: VirtualClock, world: World) -> None:
    with DirectChamber(world) as chamber:
        interface: Chamber = chamber
        interface.set_limits(-55.0, 90.0)
        interface.start()
        interface.go_to(60.0)
        clock.sleep(7200.0)
        reading = interface.read()
        assert reading.temperature_c == pytest.approx(60.0, abs=1e-3)
        assert (reading.setpoint_c, reading.alarms) == (60.0, ())
        assert reading.power_percent > 0.0
        with pytest.raises(InstrumentError, match=r"commanded to 95\.0 °C, its limits are -55\.0 to 90\.0 °C"):
            interface.go_to(95.0)
        with pytest.raises(UsageError, match="lower one first"):
            interface.set_limits(10.0, -10.0)
        interface.stop()
        assert interface.read().power_percent == 0.0


def test_a_stream_gives_all_scans_that_are_due(clock: VirtualClock, digitizer: Digitizer) -> None:
    clock.sleep(2.5)
    start = digitizer.start_stream(500.0)
    assert (start.rate_hz, start.start_s) == (500.0, 2.5)
    clock.sleep(1.0)
    first = digitizer.read_stream(400, 0.0)
    clock.sleep(1.0)
    second = digitizer.read_stream(500, 0.0)
    assert (first.first_index, first.gyro_v.size) == (0, 501)
    assert (second.first_index, second.gyro_v.size) == (501, 500)
    assert second.backlog == 0
    clock.sleep(0.002)
    assert digitizer.read_stream(0, 0.0).first_index == 1001
    with pytest.raises(LinkError, match="1 scans were requested, 0 came"):
        digitizer.read_stream(0, 0.0)


def test_volts_fall_on_steps_of_the_converter(clock: VirtualClock) -> None:
    world = World(clock, WorldSettings())
    with DirectDigitizer(world, adc_range_v=10.0) as digitizer:
        digitizer.start_stream(100.0)
        clock.sleep(1.0)
        block = digitizer.read_stream(100, 0.0)
    steps = (block.gyro_v + 10.0) * 2**16 / 20.0
    np.testing.assert_array_equal(steps, np.round(steps))
    assert np.unique(steps).size > 1


def test_scans_that_do_not_come_in_time_are_counted(clock: VirtualClock, digitizer: Digitizer) -> None:
    digitizer.start_stream(10.0)
    clock.sleep(1.0)
    with pytest.raises(LinkError, match=r"20 scans were requested, 11 came within 0\.01 s"):
        digitizer.read_stream(20, 0.01)
    clock.sleep(1.0)
    assert digitizer.read_stream(20, 0.01).gyro_v.size == 21


def test_one_reading_is_of_now(clock: VirtualClock, table: RateTable, digitizer: Digitizer) -> None:
    table.go_to_rate(100.0)
    clock.sleep(5.0)
    scan = digitizer.read_once()
    assert scan.gyro_v == pytest.approx(0.012 + 0.05 / 0.0045 * math.sin(0.45), abs=2e-4)
    assert scan.thermistor_v == pytest.approx(1.0, abs=2e-4)
    assert scan.encoder_count == pytest.approx(table.read().angle_deg * 1000.0 + 360_000.0, abs=1.0)


def test_streams_and_readings_out_of_turn_are_refused(digitizer: Digitizer) -> None:
    with pytest.raises(UsageError, match="start one first"):
        digitizer.read_stream(1, 0.0)
    with pytest.raises(UsageError, match="finite rate above 0"):
        digitizer.start_stream(0.0)
    digitizer.start_stream(100.0)
    with pytest.raises(UsageError, match="stop it first"):
        digitizer.start_stream(100.0)
    with pytest.raises(UsageError, match="stop it first"):
        digitizer.read_once()
    digitizer.stop_stream()
    digitizer.stop_stream()
    assert digitizer.read_once().encoder_count == 0


def test_everything_says_who_it_is(world: World) -> None:
    names = [part.identify().model for part in (DirectRateTable(world), DirectChamber(world), DirectDigitizer(world))]
    assert names == ["simulated rate table", "simulated chamber", "simulated digitizer"]
