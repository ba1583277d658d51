from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from benchctl.recordings.schema import write_attribute


@pytest.fixture
def file(tmp_path: Path) -> Iterator[h5py.File]:
    with h5py.File(tmp_path / "a.h5", "w", track_order=True) as opened:
        yield opened


@pytest.mark.parametrize(
    "value", ["", "Ö. Ångström °C", "x" * 100_000, 0, -(1 << 62), 0.1, float("inf"), np.int64(7), np.float64(0.3)]
)
def test_an_attribute_is_what_h5py_would_have_written(file: h5py.File, value: str | float) -> None:
    write_attribute(file, "größe", value)
    file.attrs["theirs"] = value
    ours, theirs = (h5py.h5a.open(file.id, name.encode()) for name in ("größe", "theirs"))
    assert file.attrs["größe"] == value
    assert ours.get_type() == theirs.get_type()
    assert ours.get_space().get_simple_extent_type() == theirs.get_space().get_simple_extent_type()


def test_a_truth_is_a_whole_number(file: h5py.File) -> None:
    write_attribute(file, "whole", True)
    assert file.attrs["whole"] == 1
    assert file.attrs["whole"].dtype == np.int64


def test_a_float_stays_one_bit_by_bit(file: h5py.File) -> None:
    value = np.nextafter(1.0, 2.0)
    write_attribute(file.create_group("steps"), "rate_dps", value)
    assert file["steps"].attrs["rate_dps"].tobytes() == value.tobytes()


@pytest.mark.parametrize(("value", "error"), [("\ud800", ValueError), ("a\0b", ValueError), (1 << 64, OverflowError)])
def test_what_hdf5_cannot_keep_is_an_error(file: h5py.File, value: str | int, error: type[Exception]) -> None:
    with pytest.raises(error):
        write_attribute(file, "name", value)
