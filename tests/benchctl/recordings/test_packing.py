from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchctl.recordings.digests import digest_of
from benchctl.recordings.schema import CHUNK, create_channels
from benchctl.recordings.writer import write_samples
from benchctl_instruments.arrays import FloatArray
from tests.benchctl.recordings import made

LENGTHS = st.one_of(st.integers(0, 40), st.integers(CHUNK - 2, CHUNK + 2), st.integers(3 * CHUNK - 2, 3 * CHUNK + 2))


def _written(path: Path, channels: dict[str, FloatArray]) -> dict[str, str]:
    with h5py.File(path, "w") as file:
        lengths = {name: len(samples) for name, samples in channels.items()}
        return write_samples(create_channels(file, lengths, made.meta()), channels)


def _noise(size: int, seed: int = 1) -> FloatArray:
    return np.random.default_rng(seed).normal(size=size)


SIGNALS = {
    "noise": lambda size: _noise(size),
    "noise of a converter": lambda size: np.round(0.5 + 1e-3 * _noise(size), 4),
    "stamps": lambda size: np.arange(size) / 1e3,
    "angle": lambda size: np.mod(np.arange(size) * 0.0036, 360.0),
    "still": lambda size: np.full(size, 25.0),
}


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(length=LENGTHS, seed=st.integers(0, 9))
def test_hdf5_itself_reads_every_bit_of_what_was_packed_here(tmp_path: Path, length: int, seed: int) -> None:
    bits = np.random.default_rng(seed).integers(0, 1 << 63, size=length, dtype=np.int64)
    channels = {"time_s": np.arange(float(length)), "gyro_v": bits.view(np.float64)}
    digests = _written(tmp_path / "a.h5", channels)
    with h5py.File(tmp_path / "a.h5") as file:
        for name, samples in channels.items():
            assert np.array_equal(file[name][:].view(np.int64), samples.view(np.int64))
            assert digests[name] == digest_of(samples)


def test_many_blocks_of_many_channels_come_back_in_their_places(tmp_path: Path) -> None:
    channels = {f"c{seed}_v": _noise(1_300_000, seed) for seed in range(3)} | {"time_s": np.arange(1_300_000.0)}
    digests = _written(tmp_path / "a.h5", channels)
    with h5py.File(tmp_path / "a.h5") as file:
        assert all(np.array_equal(file[name][:], samples) for name, samples in channels.items())
    assert digests == {name: digest_of(samples) for name, samples in channels.items()}


def test_the_samples_may_lie_in_another_file(tmp_path: Path) -> None:
    samples = _noise(CHUNK + 100)
    with h5py.File(tmp_path / "source.h5", "w") as source:
        stored = source.create_dataset("a", data=samples, chunks=(4096,), maxshape=(None,))
        with h5py.File(tmp_path / "a.h5", "w") as file:
            write_samples(create_channels(file, {"time_s": len(samples)}, made.meta()), {"time_s": stored})
            assert np.array_equal(file["time_s"][:], samples)


def test_the_file_asks_for_no_filter_but_shuffle_and_gzip(tmp_path: Path) -> None:
    _written(tmp_path / "a.h5", {"time_s": np.arange(3.0 * CHUNK)})
    with h5py.File(tmp_path / "a.h5") as file:
        storage = file["time_s"].id.get_create_plist()
        filters = [storage.get_filter(number)[0] for number in range(storage.get_nfilters())]
        assert filters == [h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE]
        assert all(file["time_s"].id.get_chunk_info(number).filter_mask == 0 for number in range(3))


@pytest.mark.parametrize("kind", SIGNALS)
def test_it_takes_no_more_room_than_what_hdf5_packs(tmp_path: Path, kind: str) -> None:
    samples = SIGNALS[kind](40 * CHUNK)
    _written(tmp_path / "a.h5", {"time_s": samples})
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        theirs = file.create_dataset(
            "theirs", data=samples, chunks=(CHUNK,), shuffle=True, compression="gzip", compression_opts=1
        )
        assert file["time_s"].id.get_storage_size() <= 1.02 * theirs.id.get_storage_size()
