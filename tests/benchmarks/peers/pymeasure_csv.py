"""PyMeasure: a procedure emits results, its worker's recorder appends lines to a CSV file and flushes each."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from tests.benchmarks.peers.points import NAMES, Point, Spent, installed

_PATIENCE_S = 600.0


def record(points: Sequence[Point], folder: Path) -> Spent:
    """As its tutorial does without a window: `Procedure`, `Results`, `Worker`."""
    experiment = installed("pymeasure.experiment")
    spent: list[float] = []

    class Points(experiment.Procedure):
        DATA_COLUMNS = [*NAMES]  # noqa: RUF012 - PyMeasure asks for a list

        def execute(self) -> None:
            began_s = time.perf_counter()
            for time_s, encoder_deg, gyro_v, gyro_temp_c in points:
                self.emit(
                    "results",
                    {"time_s": time_s, "encoder_deg": encoder_deg, "gyro_v": gyro_v, "gyro_temp_c": gyro_temp_c},
                )
            spent.append(time.perf_counter() - began_s)

    file = folder / "points.csv"
    began_s = time.perf_counter()
    worker = experiment.Worker(experiment.Results(Points(), str(file)))
    worker.start()
    worker.join(_PATIENCE_S)
    whole_s = time.perf_counter() - began_s
    lines = [line for line in file.read_text().splitlines() if not line.startswith("#")]
    return Spent(spent[0], whole_s, len(lines) - 1)
