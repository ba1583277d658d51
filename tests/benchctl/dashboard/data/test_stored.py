"""Stretches of channels, read past HDF5's library: bit by bit what h5py reads, and damage is one clear line."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.dashboard.data.stored import ChangedError, Samples, Stamp, samples_of
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

CHUNK = 1000
COUNT = 4321


def _values() -> FloatArray:
    values = np.random.default_rng(1).normal(size=COUNT)
    values[17] = np.nan
    return values


def _file(folder: Path, **storage: object) -> Path:
    path = folder / "one.h5"
    with h5py.File(path, "w") as file:
        file.create_group("steps/0001").create_dataset("gyro_v", data=_values(), **storage)
    return path


OURS = {"chunks": (CHUNK,), "shuffle": True, "compression": "gzip", "compression_opts": 1}


def _channel(path: Path) -> Samples:
    with h5py.File(path, "r") as file:
        return samples_of(path, file, 1, "gyro_v", Stamp.of(path))


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Samples:
    return _channel(_file(tmp_path_factory.mktemp("ours"), **OURS))


@settings(deadline=None, max_examples=60)
@given(st.integers(0, COUNT), st.integers(0, COUNT))
def test_any_stretch_is_what_was_written(ours: Samples, one: int, other: int) -> None:
    first, end = sorted((one, other))
    assert ours.read(first, end).tobytes() == _values()[first:end].tobytes()


@pytest.mark.parametrize(
    "storage",
    [{}, {"chunks": (CHUNK,)}, {"chunks": (CHUNK,), "compression": "gzip"}, OURS | {"fletcher32": True}, OURS],
)
def test_channels_that_are_stored_otherwise_are_read_all_the_same(tmp_path: Path, storage: dict[str, object]) -> None:
    channel = _channel(_file(tmp_path, **storage))
    assert channel.length == COUNT
    assert channel.read(990, 2010).tobytes() == _values()[990:2010].tobytes()


def test_integers_and_single_precision_become_float64(tmp_path: Path) -> None:
    path = tmp_path / "one.h5"
    with h5py.File(path, "w") as file:
        file.create_group("steps/0001").create_dataset("gyro_v", data=np.arange(9, dtype=">i2"))
    assert _channel(path).read(2, 5).tolist() == [2.0, 3.0, 4.0]


def test_a_file_that_was_replaced_or_removed_since_is_looked_at_again(tmp_path: Path) -> None:
    path = _file(tmp_path, **OURS)
    channel = _channel(path)
    path.write_bytes(b"another one")
    with pytest.raises(ChangedError):
        channel.read(0, 10)
    path.unlink()
    with pytest.raises(ChangedError):
        channel.read(0, 10)


def test_a_damaged_chunk_is_named_in_a_line(tmp_path: Path) -> None:
    path = _file(tmp_path, **OURS)
    with h5py.File(path, "r") as file:
        place = file["steps/0001/gyro_v"].id.get_chunk_info(2).byte_offset
    content = bytearray(path.read_bytes())
    content[place : place + 200] = bytes(200)
    path.write_bytes(content)
    channel = _channel(path)
    assert channel.read(0, 2000).size == 2000
    with pytest.raises(UsageError, match="chunk 2 is damaged; benchctl verify"):
        channel.read(0, 2001)


def test_a_chunk_that_would_inflate_beyond_its_size_is_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "one.h5"
    with h5py.File(path, "w") as file:
        dataset = file.create_group("steps/0001").create_dataset(
            "gyro_v", (10,), dtype="<f8", **(OURS | {"chunks": (10,)})
        )
        dataset[:] = 1.0
    channel = _channel(path)
    with h5py.File(path, "r+") as file:
        import zlib

        file["steps/0001/gyro_v"].id.write_direct_chunk((0,), zlib.compress(bytes(1 << 18)))
    channel = _channel(path)
    assert channel.read(0, 10).tolist() == [0.0] * 10


def test_what_is_no_channel_is_refused(tmp_path: Path) -> None:
    path = _file(tmp_path, **OURS)
    with h5py.File(path, "r") as file, pytest.raises(UsageError, match="channel gyro_x"):
        samples_of(path, file, 1, "gyro_x", Stamp.of(path))
