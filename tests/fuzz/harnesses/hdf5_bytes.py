"""Recordings in HDF5, any byte of them changed; also those of an HDF5 that has no checksums in its headers.

The library that reads HDF5 is in C, and not ours; it has died of such files, and looped for ever.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from benchctl.recordings.model import FloatArray
from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import verify
from benchctl.recordings.writer import write_recording
from tests.benchctl.recordings import made
from tests.fuzz.harness import Harness, refusals, workplace


def one_input(data: bytes) -> None:
    path = workplace() / ("a.h5" if len(data) % 2 else "0001_a.h5.part")
    path.write_bytes(data)
    read_everything(path)


def read_everything(path: Path) -> list[FloatArray]:
    """Open a file, load each step, check all digests; returns the samples of all channels that could be read."""
    found: list[FloatArray] = []
    with refusals(), open_recording(path) as recording:
        for info in recording.infos:
            with refusals():
                found += recording.step(info.index).channels.values()
    with refusals():
        for problem in verify(path):
            str(problem).encode("utf-8")
    assert all(samples.dtype == np.float64 and samples.ndim == 1 for samples in found)
    return found


def seeds() -> list[bytes]:
    return [small_recording(), _without_checksums(small_recording()), _without_checksums(small_recording()) + b"\0"]


def small_recording() -> bytes:
    """A recording of two short steps."""
    path = workplace() / "seed.h5"
    write_recording(path, made.meta(provenance={"operator": "A"}), [made.step(1, rows=8), made.step(2, rows=8)])
    return path.read_bytes()


def _without_checksums(recording: bytes) -> bytes:
    """The same in HDF5's oldest layout, whose headers believe every bit."""
    source, target = workplace() / "new.h5", workplace() / "old.h5"
    source.write_bytes(recording)
    with h5py.File(source) as new, h5py.File(target, "w", libver="earliest") as old:
        for name, value in new.attrs.items():
            old.attrs[name] = value
        for name, step in new["steps"].items():
            group = old.create_group(f"steps/{name}")
            for key, value in step.attrs.items():
                group.attrs[key] = value
            for channel, dataset in step.items():
                group.create_dataset(channel, data=dataset[:], chunks=True, compression="gzip")
    return target.read_bytes()


HARNESS = Harness(name="hdf5_bytes", weight=4, one_input=one_input, seeds=seeds, native=True, longest=65536)
