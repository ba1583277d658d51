"""bluesky: its event documents into JSON lines by suitcase, flushed each.

Without the RunEngine, which would cost far more and has another purpose: to play plans; and without checking the
documents against their schema.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from tests.benchmarks.peers.points import NAMES, Point, Spent, installed


def record(points: Sequence[Point], folder: Path) -> Spent:
    """An event document a point."""
    event_model, jsonl = installed("event_model"), installed("suitcase.jsonl")
    began_s = time.perf_counter()
    with jsonl.Serializer(folder, flush=True) as serializer:
        run = event_model.compose_run()
        serializer("start", run.start_doc)
        keys = {name: {"dtype": "number", "shape": [], "source": "bench"} for name in NAMES}
        descriptor = run.compose_descriptor(name="primary", data_keys=keys)
        serializer("descriptor", descriptor.descriptor_doc)
        first_s = time.perf_counter()
        for time_s, encoder_deg, gyro_v, gyro_temp_c in points:
            data = {"time_s": time_s, "encoder_deg": encoder_deg, "gyro_v": gyro_v, "gyro_temp_c": gyro_temp_c}
            stamps = dict.fromkeys(data, time_s)
            serializer("event", descriptor.compose_event(data=data, timestamps=stamps, validate=False))
        points_s = time.perf_counter() - first_s
        serializer("stop", run.compose_stop())
    whole_s = time.perf_counter() - began_s
    (file,) = folder.glob("*.jsonl")
    return Spent(points_s, whole_s, sum(line.startswith('["event"') for line in file.read_text().splitlines()))
