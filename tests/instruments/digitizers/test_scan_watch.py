from __future__ import annotations

import math

import numpy as np
import pytest

from benchctl_instruments.digitizers.scan_watch import ScanWatch, refuse_at_rail
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.interfaces import ScanBlock


def block(counts: list[int], *, first_index: int = 0, gyro_v: float = 1.0, thermistor_v: float = 1.0) -> ScanBlock:
    n = len(counts)
    return ScanBlock(
        first_index=first_index,
        encoder_count=np.array(counts, np.int64),
        gyro_v=np.full(n, gyro_v),
        thermistor_v=np.full(n, thermistor_v),
    )


def watch(*, fastest_counts_per_s: float = 10_000.0, frozen_s: float = math.inf) -> ScanWatch:
    return ScanWatch(100.0, fastest_counts_per_s=fastest_counts_per_s, range_v=10.0, frozen_s=frozen_s)


@pytest.mark.parametrize("jump", [500, -500])
def test_a_count_that_jumps_is_named_with_its_scan_and_instant(jump: int) -> None:
    looker = watch()
    looker.look(block([0, 100, 200]))
    with pytest.raises(InstrumentError, match=rf"count jumps by {jump + 100} at scan 5 \(0\.050 s after the start"):
        looker.look(block([300, 400, 500 + jump], first_index=3))


def test_a_jump_between_two_blocks_is_found_and_one_across_a_gap_is_none() -> None:
    looker = watch()
    looker.look(block([0, 100]))
    looker.look(block([5000, 5100], first_index=50))
    with pytest.raises(InstrumentError, match="jumps by 900 at scan 52"):
        looker.look(block([6000], first_index=52))


def test_the_fastest_turn_is_no_jump_and_without_a_limit_nothing_is() -> None:
    watch().look(block([0, 100, 200, 400]))  # 100 counts a scan, and 100 to spare
    watch(fastest_counts_per_s=math.inf).look(block([0, 1 << 31]))


def test_inputs_that_do_not_change_by_a_single_code_are_frozen_after_a_while() -> None:
    looker = watch(frozen_s=1.0)
    looker.look(block([5] * 60))
    with pytest.raises(InstrumentError, match=r"have not changed by a single code for 1\.\d s"):
        looker.look(block([5] * 60, first_index=60))


def test_any_change_on_any_input_shows_that_nothing_is_frozen() -> None:
    looker = watch(frozen_s=1.0)
    for place in range(10):
        looker.look(block([5] * 60, first_index=60 * place, gyro_v=1.0 + 1e-4 * (place % 2)))


def test_a_gap_does_not_count_as_time_without_change() -> None:
    looker = watch(frozen_s=1.0)
    looker.look(block([5] * 90))
    looker.look(block([5] * 90, first_index=500))


@pytest.mark.parametrize("volts", [10.0, -10.0, 9.9997])
def test_a_thermistor_at_the_end_of_its_range_is_no_temperature(volts: float) -> None:
    with pytest.raises(InstrumentError, match="the end of its range: there is no temperature"):
        watch().look(block([0, 1], thermistor_v=volts))
    with pytest.raises(InstrumentError, match="there is no temperature"):
        refuse_at_rail(volts, 10.0)
    refuse_at_rail(9.9, 10.0)


def test_a_gyro_at_the_end_of_its_range_may_be_turning() -> None:
    watch().look(block([0, 1], gyro_v=10.0))
