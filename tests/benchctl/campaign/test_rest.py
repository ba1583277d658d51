import math
from collections.abc import Iterator

import pytest

from benchctl.bench import load_bench
from benchctl.campaign.opened import OpenBench, open_bench
from benchctl.campaign.rest import rest_within_s, send_home, stop_table, wait_for_rest
from benchctl_instruments.errors import SafetyError
from benchctl_instruments.interfaces import RateTable, TableReading, TableState


@pytest.fixture
def turning() -> Iterator[OpenBench]:
    with open_bench(load_bench("simulated"), wires=False) as opened:
        opened.table.enable()
        opened.table.go_to_rate(200.0)
        opened.clock.sleep(1.0)
        yield opened


def test_a_table_is_told_to_stop_and_waited_for_with_a_beat_at_each_look(turning: OpenBench) -> None:
    beats: list[float] = []
    rate_dps = stop_table(turning.table, turning.clock, 6.0, lambda: beats.append(turning.table.read().rate_dps))
    assert abs(rate_dps) < 0.05
    slowing = [rate_dps for rate_dps in beats if rate_dps > 0.05]
    assert slowing[0] > 10.0
    assert slowing == sorted(slowing, reverse=True)


def test_a_table_that_does_not_come_to_rest_in_time_is_an_error_that_says_how_fast_it_turns(turning: OpenBench) -> None:
    with pytest.raises(SafetyError, match=r"should have come to rest, but still turns at \+\d+\.\d+ deg/s"):
        stop_table(turning.table, turning.clock, 0.0, lambda: turning.table.go_to_rate(200.0))


def test_a_table_that_swings_through_zero_is_not_at_rest_yet(
    turning: OpenBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    began_s = turning.clock.now()

    def swinging(table: RateTable) -> TableReading:
        elapsed_s = turning.clock.now() - began_s
        rate_dps = 2.0 * math.exp(-2.0 * elapsed_s) * math.sin(2.0 * math.pi * 2.5 * elapsed_s)
        return TableReading(angle_deg=0.0, rate_dps=rate_dps, acceleration_dps2=0.0)

    monkeypatch.setattr(type(turning.table), "read", swinging)
    assert abs(wait_for_rest(turning.table, turning.clock, 6.0, lambda: None)) < 0.05
    # sin(0) = 0 at the first look and again every 0.2 s; the swing itself is below 0.05 deg/s after 1.84 s
    assert turning.clock.now() - began_s > 1.5


def test_a_table_whose_servo_is_off_is_not_told_anything_but_waited_for(
    turning: OpenBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def told(*_: object) -> None:
        raise AssertionError("it was told to stop")

    turning.table.stop()
    monkeypatch.setattr(type(turning.table), "state", lambda table: TableState.FAULT)
    monkeypatch.setattr(type(turning.table), "stop", told)
    assert abs(stop_table(turning.table, turning.clock, 6.0, lambda: None)) < 0.05


def test_a_chamber_sent_home_reads_back_its_safe_set_point(turning: OpenBench) -> None:
    remarks: list[str] = []
    turning.chamber.go_to(60.0)
    assert send_home(turning.chamber, 23.0, remarks.append) == turning.chamber.read().setpoint_c == 23.0
    assert remarks == []


def test_the_time_to_rest_grows_with_the_rate_and_falls_with_the_acceleration() -> None:
    assert rest_within_s(300.0, 1500.0) == pytest.approx(5.8)
    assert rest_within_s(300.0, 10.0) == pytest.approx(125.0)
