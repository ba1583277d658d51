"""Small recordings for the tests of reading and writing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from benchctl.recordings.hdf5_guard import note_own
from benchctl.recordings.model import BenchFacts, Meta, Step, StepInfo, Unit
from benchctl.recordings.writer import write_recording
from benchctl_instruments.arrays import FloatArray

RATE_HZ = 100.0
STREAMED = ("time_s", "encoder_deg", "gyro_v", "gyro_temp_c")
POLLED = ("poll_time_s", "poll_chamber_temp_c")


def meta(**changes: object) -> Meta:
    values: dict[str, object] = {
        "status": "complete",
        "unit": Unit(serial="VG-7", range_dps=150.0, model="VG910Q"),
        "bench": BenchFacts(sample_rate_hz=RATE_HZ, encoder_counts_per_rev=360000, adc_bits=16, adc_range_v=10.0),
        "provenance": {
            "procedure": "two_stage",
            "source": "def steps():\n    yield\n" * 2000,
            "operator": "Ö. Ångström",
        },
    }
    return Meta(**(values | changes))  # type: ignore[arg-type]


def info(index: int, *, t_start: float = 0.0, t_end: float = 1.0, **changes: object) -> StepInfo:
    values: dict[str, object] = {
        "index": index,
        "name": f"rate {index:+d}",
        "kind": "constant_rate",
        "t_start": t_start,
        "t_end": t_end,
        "chamber_setpoint_c": 20.0,
        "rate_dps": 10.0 * index,
        "sample_rate_hz": RATE_HZ,
    }
    return StepInfo(**(values | changes))  # type: ignore[arg-type]


def streamed(t_start: float, rows: int, seed: int = 0) -> dict[str, FloatArray]:
    chance = np.random.default_rng(seed)
    return {
        "time_s": t_start + np.arange(rows) / RATE_HZ,
        "encoder_deg": np.mod(np.arange(rows) * 0.5, 360.0),
        "gyro_v": 2.5 + chance.normal(size=rows),
        "gyro_temp_c": 20.0 + 0.01 * chance.normal(size=rows),
    }


def polled(t_start: float, rows: int = 3) -> dict[str, FloatArray]:
    return {"poll_time_s": t_start + np.arange(rows), "poll_chamber_temp_c": np.linspace(20.0, 21.0, rows)}


def step(index: int, rows: int = 200, t_start: float | None = None, **changes: object) -> Step:
    start = 100.0 * index if t_start is None else t_start
    described = info(index, t_start=start, t_end=start + rows / RATE_HZ, **changes)
    return Step(described, {**streamed(start, rows, seed=index), **polled(start)})


def steps(count: int) -> Iterator[Step]:
    return (step(index) for index in range(1, count + 1))


def recording(folder: Path, count: int = 3, **changes: object) -> Path:
    path = folder / "made.h5"
    write_recording(path, meta(**changes), steps(count))
    return path


@contextmanager
def changed(path: Path) -> Iterator[h5py.File]:
    """A recording as HDF5 sees it, to be changed: still this process's own, so that no child has to open it first."""
    with h5py.File(path, "r+") as file:
        yield file
    note_own(path)


def same(one: Step, other: Step) -> bool:
    """Whether two steps have the same channels, bit by bit."""
    return one.channels.keys() == other.channels.keys() and all(
        np.array_equal(one[name].view(np.int64), other[name].view(np.int64)) for name in one.channels
    )
