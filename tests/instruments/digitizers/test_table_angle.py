from __future__ import annotations

import numpy as np
import pytest

from benchctl_instruments.digitizers.table_angle import TableAngleDigitizer
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.direct import DirectDigitizer, DirectRateTable
from benchctl_instruments.simulated.world import World


@pytest.mark.parametrize(("rate_dps", "counts_per_rev"), [(0.0, 360_000), (100.0, 360_000), (-170.0, -3600)])
def test_the_angle_of_each_scan_is_that_of_the_table_at_its_instant(rate_dps: float, counts_per_rev: int) -> None:
    """Between two looks of 5 s the table makes more than a revolution."""
    clock = VirtualClock()
    world = World(clock)
    table = DirectRateTable(world)
    table.enable()
    table.go_to_rate(rate_dps)
    clock.sleep(5.0)
    digitizer = TableAngleDigitizer(
        DirectDigitizer(world), table, clock=clock, degrees_per_count=360.0 / counts_per_rev
    )
    with digitizer:
        here = digitizer.read_once()
        assert here.encoder_count * 360.0 / counts_per_rev == pytest.approx(
            table.read().angle_deg, abs=180.0 / abs(counts_per_rev)
        )
        digitizer.start_stream(5.0)
        start_deg = table.read().angle_deg
        counts = []
        for pause_s in (5.0, 5.0, 0.25, 3.0):
            clock.sleep(pause_s)
            counts.append(digitizer.read_stream(1, 1.0).encoder_count)
        digitizer.stop_stream()
    angles_deg = np.concatenate(counts) * 360.0 / counts_per_rev
    expected_deg = start_deg + rate_dps * np.arange(angles_deg.size) / 5.0
    assert angles_deg.size == 67
    assert angles_deg == pytest.approx(expected_deg, abs=180.0 / abs(counts_per_rev) + 1e-3)
