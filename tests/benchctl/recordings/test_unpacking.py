"""Whatever HDF5 can hold comes back bit by bit as h5py gives it, and what it refuses is refused in its words."""

from __future__ import annotations

import tracemalloc
import zlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from benchctl.recordings import opening
from benchctl.recordings.opening import read_samples

SAMPLES = np.random.default_rng(4).normal(size=5000)
SAMPLES[[7, 8, 9]] = np.nan, np.inf, -0.0

OURS: dict[str, Any] = {"chunks": (512,), "shuffle": True, "compression": "gzip"}
LAYOUTS: dict[str, dict[str, Any]] = {
    "ours": OURS,
    "chunks of an odd size": {**OURS, "chunks": (333,)},
    "one chunk larger than the samples": {**OURS, "chunks": (6000,), "maxshape": (None,)},
    "not shuffled": {"chunks": (512,), "compression": "gzip"},
    "not compressed": {"chunks": (512,), "shuffle": True},
    "with checksums": {**OURS, "fletcher32": True},
    "plain chunks": {"chunks": (512,)},
    "in one piece": {},
    "big-endian": {**OURS, "dtype": ">f8"},
    "narrow": {**OURS, "dtype": "<f4"},
    "whole numbers": {**OURS, "dtype": "<i2"},
}
RANGES = [(0, 5000), (0, 512), (512, 1024), (1, 511), (511, 513), (700, 4321), (4999, 5000), (37, 37)]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_any_stretch_of_any_layout_is_what_h5py_reads(tmp_path: Path, layout: str) -> None:
    with np.errstate(invalid="ignore"), h5py.File(tmp_path / "a.h5", "w") as file:
        dataset = file.create_dataset("a", data=SAMPLES.astype(LAYOUTS[layout].get("dtype", "<f8")), **LAYOUTS[layout])
        for start, stop in RANGES:
            found, expected = read_samples(dataset, start, stop), dataset[start:stop].astype(np.float64)
            assert found.dtype == np.float64
            assert np.array_equal(found.view(np.int64), expected.view(np.int64)), (start, stop)


def test_our_own_layout_does_not_need_h5py(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        dataset = file.create_dataset("a", data=SAMPLES, **OURS)
        monkeypatch.setattr(h5py.Dataset, "__getitem__", None)
        assert np.array_equal(read_samples(dataset, 100, 4900), SAMPLES[100:4900], equal_nan=True)


def _absent(dataset: h5py.Dataset) -> None:
    """Chunks that nobody ever wrote."""


def _half(dataset: h5py.Dataset) -> None:
    dataset[1024:2048] = SAMPLES[1024:2048]


def _left_as_it_is(dataset: h5py.Dataset) -> None:
    dataset[:] = SAMPLES
    dataset.id.write_direct_chunk((512,), SAMPLES[:512].tobytes(), filter_mask=0b11)


@pytest.mark.parametrize("write", [_absent, _half, _left_as_it_is])
def test_chunks_that_are_not_there_or_not_packed_are_read_as_h5py_reads_them(
    tmp_path: Path, write: Callable[[h5py.Dataset], None]
) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        dataset = file.create_dataset("a", (5000,), "<f8", fillvalue=-1.5, **OURS)
        write(dataset)
        assert np.array_equal(read_samples(dataset, 3, 4997), dataset[3:4997], equal_nan=True)


@pytest.mark.parametrize("chunk", [b"no deflate", zlib.compress(bytes(4096))[:-6]])
def test_a_damaged_chunk_is_refused_in_the_words_of_h5py(tmp_path: Path, chunk: bytes) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        dataset = file.create_dataset("a", data=SAMPLES, **OURS)
        dataset.id.write_direct_chunk((1024,), chunk)
        said = []
        for read in (lambda: dataset[:], lambda: read_samples(dataset, 0, 5000)):
            with pytest.raises(OSError, match="filter returned failure") as caught:
                read()
            said.append(str(caught.value))
        assert said[0] == said[1]
        assert np.array_equal(read_samples(dataset, 0, 1024), SAMPLES[:1024], equal_nan=True)


def test_a_chunk_that_would_blow_up_is_not_inflated_beyond_its_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        dataset = file.create_dataset("a", data=SAMPLES, **OURS)
        dataset.id.write_direct_chunk((0,), zlib.compress(bytes(200_000_000)))
        monkeypatch.setattr(h5py.Dataset, "__getitem__", lambda *_: 7.0)  # what HDF5 does with it is its own business
        tracemalloc.start()
        assert read_samples(dataset, 0, 512).tolist() == [7.0] * 512
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert most < 2_000_000


def test_many_threads_may_read_one_channel(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        dataset = file.create_dataset("a", data=SAMPLES, **OURS)
        with ThreadPoolExecutor(8) as pool:
            found = list(pool.map(lambda start: read_samples(dataset, start, start + 100), range(0, 4900, 7)))
    for start, samples in zip(range(0, 4900, 7), found, strict=True):
        assert np.array_equal(samples, SAMPLES[start : start + 100], equal_nan=True)


def test_filling_leaves_the_rest_of_an_array_alone(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        dataset = file.create_dataset("a", data=SAMPLES, **OURS)
        samples = np.zeros(1000)
        opening.fill(dataset, 600, samples[100:200])
    assert np.array_equal(samples[100:200], SAMPLES[600:700])
    assert not samples[:100].any()
    assert not samples[200:].any()
