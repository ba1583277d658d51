"""h5py by hand, as one would write it without a library around: a table that grows by a row, or an array at once."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from benchctl.recordings.schema import CHUNK
from benchctl_instruments.arrays import FloatArray
from tests.benchmarks.peers.points import NAMES, Point, Spent


def _record(points: Sequence[Point], folder: Path, after_each: Callable[[h5py.File], None]) -> Spent:
    began_s = time.perf_counter()
    with h5py.File(folder / "points.h5", "w", libver="latest") as file:
        table = file.create_dataset(
            "points", (0, len(NAMES)), maxshape=(None, len(NAMES)), chunks=(4096, len(NAMES)), dtype="<f8"
        )
        file.swmr_mode = True
        first_s = time.perf_counter()
        for number, point in enumerate(points):
            table.resize(number + 1, axis=0)
            table[number] = point
            after_each(file)
        file.flush()
        points_s = time.perf_counter() - first_s
    whole_s = time.perf_counter() - began_s
    with h5py.File(folder / "points.h5") as file:
        return Spent(points_s, whole_s, len(file["points"]))


record = partial(_record, after_each=lambda _: None)
"""Without a flush: what is killed loses everything since the file was opened."""
record_flushed = partial(_record, after_each=h5py.File.flush)
"""With a flush a row: a kill loses nothing."""


def write_at_once(channels: Mapping[str, FloatArray], path: Path) -> float:
    """Seconds to write whole arrays in chunks and filters as a recording has them; not synced to the disk."""
    began_s = time.perf_counter()
    with h5py.File(path, "w") as file:
        for name, samples in channels.items():
            file.create_dataset(
                name, data=samples, chunks=(CHUNK,), shuffle=True, compression="gzip", compression_opts=1
            )
    return time.perf_counter() - began_s


def read_back(path: Path) -> dict[str, FloatArray]:
    """What `write_at_once` wrote."""
    with h5py.File(path) as file:
        return {name: np.asarray(dataset[:]) for name, dataset in file.items()}
