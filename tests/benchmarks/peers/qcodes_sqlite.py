"""QCoDeS: `add_result` into a SQLite data set; by default what came is written every five seconds."""

from __future__ import annotations

import contextlib
import io
import time
from collections.abc import Sequence
from pathlib import Path

from tests.benchmarks.peers.points import NAMES, Point, Spent, installed


def record(points: Sequence[Point], folder: Path) -> Spent:
    """As its introduction does, with custom parameters; the data base was made before."""
    dataset = installed("qcodes.dataset")
    with contextlib.redirect_stdout(io.StringIO()):
        dataset.initialise_or_create_database_at(folder / "points.db")
        measurement = dataset.Measurement(exp=dataset.load_or_create_experiment("points", "VG-7"))
        axis, *others = NAMES
        measurement.register_custom_parameter(axis)
        for name in others:
            measurement.register_custom_parameter(name, setpoints=(axis,))
        began_s = time.perf_counter()
        with measurement.run() as saver:
            first_s = time.perf_counter()
            for time_s, encoder_deg, gyro_v, gyro_temp_c in points:
                saver.add_result(
                    ("time_s", time_s),
                    ("encoder_deg", encoder_deg),
                    ("gyro_v", gyro_v),
                    ("gyro_temp_c", gyro_temp_c),
                )
            saver.flush_data_to_database(block=True)
            points_s = time.perf_counter() - first_s
        whole_s = time.perf_counter() - began_s
        stored = len(saver.dataset.get_parameter_data("gyro_v")["gyro_v"]["time_s"])
        saver.dataset.conn.close()
    return Spent(points_s, whole_s, stored)
