"""The driver of a table that is turned by hand, over the simulated encoder, with an operator that is a function."""

from __future__ import annotations

import math

import pytest

from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import SingleScan, TableLimits, TableState
from benchctl_instruments.rate_tables.manual import ManualTable, WatchedDigitizer
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.direct import DirectDigitizer
from benchctl_instruments.simulated.manual import turn_by_hand
from benchctl_instruments.simulated.world import World


class Bench:
    """A manual table over a simulated world; `asked` are the rates that its operator was commanded, and turned at."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.world = World(self.clock)
        self.digitizer = WatchedDigitizer(DirectDigitizer(self.world), clock=self.clock, degrees_per_count=0.001)
        self.table = ManualTable(clock=self.clock, encoder=self.digitizer)
        self.asked: list[float] = []
        self.table.operator = self.turn
        self.table.set_limits(TableLimits(rate_dps=100.0, acceleration_dps2=500.0))

    def turn(self, rate_dps: float) -> None:
        self.asked.append(rate_dps)
        turn_by_hand(self.world.table, 1.03 * rate_dps)
        self.clock.sleep(20.0)


def test_what_is_read_is_what_the_encoder_shows_and_not_what_was_commanded() -> None:
    bench = Bench()
    assert (bench.table.read().rate_dps, bench.table.state()) == (0.0, TableState.AT_REST)
    bench.table.go_to_rate(-40.0)
    assert bench.asked == [-40.0]
    assert bench.table.read().rate_dps == pytest.approx(-41.2, abs=0.1)
    assert math.isnan(bench.table.read().acceleration_dps2)
    assert bench.table.state() is TableState.MOVING


def test_while_a_stream_runs_its_scans_show_the_rate() -> None:
    bench = Bench()
    bench.table.go_to_rate(40.0)
    rate_hz = bench.digitizer.start_stream(500.0).rate_hz
    bench.clock.sleep(6.0)
    bench.digitizer.read_stream(int(5.5 * rate_hz), timeout_s=1.0)
    assert bench.table.read().rate_dps == pytest.approx(41.2, abs=0.01)


def test_a_stop_ends_the_stream_and_asks_only_where_the_table_turns() -> None:
    bench = Bench()
    bench.table.stop()
    assert bench.asked == []
    bench.table.go_to_rate(40.0)
    bench.digitizer.start_stream(500.0)
    bench.table.stop()
    assert bench.asked == [40.0, 0.0]
    assert abs(bench.table.read().rate_dps) < 0.05  # no stream keeps it from being read


def test_a_rate_of_zero_is_a_stop() -> None:
    bench = Bench()
    bench.table.go_to_rate(0.0)
    assert bench.asked == []


def test_a_stop_is_asked_for_where_the_encoder_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    def silent() -> SingleScan:
        raise LinkError("no answer")

    bench = Bench()
    monkeypatch.setattr(bench.digitizer, "read_once", silent)
    bench.table.stop()
    assert bench.asked == [0.0]
    assert bench.table.state() is TableState.MOVING
    with pytest.raises(LinkError):
        bench.table.read()


@pytest.mark.parametrize(("counts", "rate_dps"), [((7, 8), 0.0), ((2**31 - 500, 500 - 2**31), 0.5)])
def test_a_single_count_is_no_motion_and_a_counter_may_wrap(
    counts: tuple[int, int], rate_dps: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    scans = iter(SingleScan(encoder_count=count, gyro_v=0.0, thermistor_v=0.0) for count in counts)
    bench = Bench()
    digitizer = DirectDigitizer(bench.world)
    monkeypatch.setattr(digitizer, "read_once", lambda: (bench.clock.sleep(1.0), next(scans))[1])
    watched = WatchedDigitizer(digitizer, clock=bench.clock, degrees_per_count=0.001)
    assert watched.motion().rate_dps == pytest.approx(rate_dps)


def test_a_rate_over_a_long_pause_is_not_the_present_one() -> None:
    bench = Bench()
    bench.table.read()
    turn_by_hand(bench.world.table, 40.0)
    bench.clock.sleep(3600.0)
    assert bench.table.read().rate_dps == pytest.approx(40.0, abs=0.1)


def test_what_no_hand_can_do_is_refused() -> None:
    bench = Bench()
    with pytest.raises(UsageError, match="only constant rates"):
        bench.table.oscillate(10.0, 0.2)
    with pytest.raises(UsageError, match="has only rates"):
        bench.table.go_to_angle(90.0)
    with pytest.raises(UsageError, match="the limit that was set is 100 deg/s"):
        bench.table.go_to_rate(101.0)
    assert bench.asked == []


def test_without_an_operator_a_rate_is_refused() -> None:
    bench = Bench()
    table = ManualTable(clock=bench.clock, encoder=bench.digitizer)
    table.set_limits(TableLimits(rate_dps=100.0, acceleration_dps2=500.0))
    with pytest.raises(InstrumentError, match="commanded 20 deg/s without an operator"):
        table.go_to_rate(20.0)
