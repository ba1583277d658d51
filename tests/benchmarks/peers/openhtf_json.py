"""OpenHTF: a measurement with a dimension, written as JSON once the test is over; what is killed before is lost."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.benchmarks.peers.points import Point, Spent, installed


def record(points: Sequence[Point], folder: Path) -> Spent:
    """One phase that fills one measurement, coordinates: the stamp."""
    openhtf = installed("openhtf")
    to_json = installed("openhtf.output.callbacks.json_factory").OutputToJSON
    spent: list[float] = []

    @openhtf.measures(openhtf.Measurement("points").with_dimensions("time_s"))
    def phase(test: Any) -> None:
        began_s = time.perf_counter()
        measurement = test.measurements.points
        for time_s, encoder_deg, gyro_v, gyro_temp_c in points:
            measurement[time_s] = (encoder_deg, gyro_v, gyro_temp_c)
        spent.append(time.perf_counter() - began_s)

    file = folder / "points.json"
    test = openhtf.Test(phase)
    test.add_output_callbacks(to_json(str(file)))
    installed("openhtf.util.console_output").CLI_QUIET = True
    began_s = time.perf_counter()
    test.execute(test_start=lambda: "VG-7")
    whole_s = time.perf_counter() - began_s
    (told,) = (one["measurements"] for one in json.loads(file.read_text())["phases"] if "points" in one["measurements"])
    return Spent(spent[0], whole_s, len(told["points"]["measured_value"]))
