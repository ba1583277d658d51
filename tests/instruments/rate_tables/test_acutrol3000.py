"""The driver against the simulated controller, over a real socket."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import pytest

from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.interfaces import Identity, RateTable, TableLimits, TableReading, TableState
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.rate_tables.acutrol3000 import Acutrol3000
from benchctl_instruments.simulated.acutrol3000 import SimulatedAcutrol3000
from tests.instruments.table_machine import CountedClock, InstantTable


@pytest.fixture
def table() -> InstantTable:
    return InstantTable(angle_deg=350.0)


@pytest.fixture
def server(table: InstantTable) -> Iterator[SimulatedAcutrol3000]:
    with SimulatedAcutrol3000(table) as running:
        yield running


@pytest.fixture
def clock() -> CountedClock:
    return CountedClock()


@pytest.fixture
def driver(server: SimulatedAcutrol3000, clock: CountedClock) -> Iterator[Acutrol3000]:
    with Acutrol3000(server.address, clock=clock, status_bits={"0": "interlock", "5": "event"}) as driver:
        yield driver


@pytest.fixture
def enabled(driver: Acutrol3000) -> Acutrol3000:
    driver.enable()
    return driver


def test_it_is_a_rate_table_and_says_who_it_is(driver: Acutrol3000) -> None:
    as_interface: RateTable = driver
    assert as_interface.identify() == Identity(manufacturer="simulated", model="ACUTROL3000", serial="1", firmware="0")


def test_it_starts_disabled_and_enabling_holds_it_still(driver: Acutrol3000, table: InstantTable) -> None:
    assert driver.state() is TableState.DISABLED
    driver.enable()
    assert driver.state() is TableState.AT_REST
    assert table.demands == [("close",), ("rate", 0.0)]


def test_enabling_never_starts_with_a_demand_that_was_left_over(enabled: Acutrol3000, table: InstantTable) -> None:
    enabled.go_to_rate(100.0)
    table.demands.clear()
    enabled.enable()
    assert set(table.demands) == {("rate", 0.0)}


def test_the_controller_is_given_time_after_a_change_of_mode(enabled: Acutrol3000, clock: CountedClock) -> None:
    before_s = clock.now()
    enabled.go_to_rate(10.0)
    assert clock.now() == before_s
    enabled.go_to_angle(0.0)
    assert clock.now() == pytest.approx(before_s + 0.2)


def test_a_rate_is_reached_and_read_in_one_combined_read(enabled: Acutrol3000, table: InstantTable) -> None:
    enabled.go_to_rate(-123.456)
    assert enabled.read() == TableReading(angle_deg=350.0, rate_dps=-123.456, acceleration_dps2=0.0)
    assert enabled.state() is TableState.MOVING


@pytest.mark.parametrize(("angle_deg", "reached_deg"), [(10.0, 370.0), (300.0, 300.0), (-20.0, 340.0), (1085.0, 365.0)])
def test_an_angle_is_reached_the_short_way_round(
    enabled: Acutrol3000, table: InstantTable, angle_deg: float, reached_deg: float
) -> None:
    enabled.go_to_angle(angle_deg)
    angles = [demand[1] for demand in table.demands if demand[0] == "angle"]
    assert angles == pytest.approx([350.0, reached_deg])
    assert enabled.state() is TableState.AT_REST


def test_an_angle_that_was_left_over_is_never_gone_to(enabled: Acutrol3000, table: InstantTable) -> None:
    enabled.go_to_angle(10.0)
    enabled.go_to_rate(0.0)
    table.angle_deg = 90.0
    table.demands.clear()
    enabled.go_to_angle(100.0)
    assert [demand[1] for demand in table.demands] == pytest.approx([90.0, 100.0])


def test_an_oscillation_has_the_demanded_peak_rate_and_rises_in_two_periods(
    enabled: Acutrol3000, table: InstantTable
) -> None:
    enabled.oscillate(amplitude_dps=960.0, frequency_hz=1.0)

    name, amplitude_deg, frequency_hz, phase_deg, slew_deg_per_s = table.demands[-1]
    assert name == "sine"
    assert amplitude_deg == pytest.approx(152.8, abs=0.05)  # a BD125 was seen to need 155 deg for 960 deg/s at 1 Hz
    assert (frequency_hz, phase_deg) == (1.0, 0.0)
    assert slew_deg_per_s == pytest.approx(float(amplitude_deg) / 2.0, rel=1e-5)


def test_a_new_oscillation_follows_an_old_one_and_a_stop_ends_it(enabled: Acutrol3000, table: InstantTable) -> None:
    enabled.oscillate(100.0, 1.0)
    enabled.oscillate(50.0, 0.5)
    assert table.demands[-1][1:3] == pytest.approx((50.0 / math.pi, 0.5), abs=1e-5)
    enabled.stop()
    assert table.demands[-1] == ("rate", 0.0)
    assert enabled.state() is TableState.AT_REST


def test_limits_hold_in_every_mode(enabled: Acutrol3000, table: InstantTable) -> None:
    enabled.set_limits(TableLimits(rate_dps=300.0, acceleration_dps2=500.0))
    assert table.limits() == (300.0, 500.0)
    enabled.go_to_angle(0.0)
    assert table.limits() == (300.0, 500.0)
    enabled.oscillate(10.0, 1.0)
    assert table.limits() == (300.0, 500.0)
    with pytest.raises(
        InstrumentError, match=r":dem:rate 1,301.0+', expected OK, got 'ERROR rate 301.0: the limit is 300"
    ):
        enabled.go_to_rate(301.0)


def test_limits_beyond_the_factorys_are_refused(driver: Acutrol3000) -> None:
    with pytest.raises(InstrumentError, match=r"the factory's limit is 1000"):
        driver.set_limits(TableLimits(rate_dps=1001.0, acceleration_dps2=500.0))


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_numbers_that_mean_nothing_never_reach_the_wire(enabled: Acutrol3000, table: InstantTable, bad: float) -> None:
    table.demands.clear()
    calls: list[Callable[[], None]] = [
        lambda: enabled.go_to_rate(bad),
        lambda: enabled.go_to_angle(bad),
        lambda: enabled.oscillate(bad, 1.0),
        lambda: enabled.oscillate(10.0, 0.0),
        lambda: enabled.oscillate(-10.0, 1.0),
        lambda: enabled.set_limits(TableLimits(rate_dps=bad, acceleration_dps2=1.0)),
        lambda: enabled.set_limits(TableLimits(rate_dps=1.0, acceleration_dps2=0.0)),
    ]
    for call in calls:
        with pytest.raises(UsageError, match="expected a finite number"):
            call()
    assert table.demands == []


def test_a_moving_table_is_not_disabled(enabled: Acutrol3000, table: InstantTable) -> None:
    enabled.go_to_rate(5.0)
    with pytest.raises(UsageError, match=r"turns at 5.000 deg/s; stop it before"):
        enabled.disable()
    assert enabled.state() is TableState.MOVING
    enabled.stop()
    enabled.disable()
    assert enabled.state() is TableState.DISABLED
    assert table.demands[-1] == ("open",)


def test_a_disabled_table_does_not_move_and_can_be_stopped(driver: Acutrol3000, table: InstantTable) -> None:
    driver.stop()
    with pytest.raises(InstrumentError, match="the interlock is open'; no fault is reported"):
        driver.go_to_rate(1.0)
    assert table.demands == []


def test_an_open_interlock_is_explained_and_cleared_by_enabling(
    enabled: Acutrol3000, server: SimulatedAcutrol3000
) -> None:
    enabled.go_to_rate(20.0)
    server.open_interlock()
    assert enabled.state() is TableState.FAULT
    moves: list[Callable[[], None]] = [
        enabled.stop,
        enabled.enable,
        lambda: enabled.go_to_rate(1.0),
        lambda: enabled.oscillate(1.0, 1.0),
    ]
    for move in moves:
        with pytest.raises(
            InstrumentError, match=r"status byte 65 \(interlock\); remove the cause.*enabling"
        ) as caught:
            move()
        assert "\n" not in str(caught.value)
    assert enabled.read().rate_dps == 0.0

    server.close_interlock()
    enabled.enable()
    assert enabled.state() is TableState.AT_REST


def test_a_velocity_trip_is_seen(enabled: Acutrol3000, table: InstantTable) -> None:
    enabled.go_to_rate(100.0)
    table.rate_dps = 1200.0
    assert enabled.state() is TableState.FAULT


def test_a_cut_link_is_no_matter_between_two_exchanges(enabled: Acutrol3000, server: SimulatedAcutrol3000) -> None:
    enabled.go_to_rate(20.0)
    server.cut_connections()
    assert enabled.read().rate_dps == 20.0
    server.cut_connections()
    enabled.go_to_rate(30.0)
    assert enabled.read().rate_dps == 30.0


def test_headers_are_kept_in_the_wire_log(server: SimulatedAcutrol3000, clock: CountedClock) -> None:
    log = WireLog()
    with Acutrol3000(server.address, clock=clock, wire_log=log) as driver:
        driver.read()
    assert any(entry.data == b"00000002350.000000;0.000000;0.000000\r\n" for entry in log.last(9))


def test_a_controller_that_does_not_tell_its_demands_can_be_driven_too(
    server: SimulatedAcutrol3000, clock: CountedClock, table: InstantTable
) -> None:
    log = WireLog(size=1000)
    with Acutrol3000(server.address, clock=clock, wire_log=log, demand_queries=False, set_slew=False) as driver:
        driver.enable()
        driver.go_to_rate(10.0)
        driver.go_to_angle(0.0)
        driver.oscillate(10.0, 1.0)
    sent = [entry.data for entry in log.last(1000) if entry.direction == "sent"]
    assert not any(data.startswith(b":dem") and b"?" in data for data in sent)
    assert not any(data.startswith(b":con:osc") for data in sent)
    assert table.demands[-1][0] == "sine"
