"""Files of blocks in the cache: whole or not there, damaged ones are as good as none, the oldest go first."""

import os
from pathlib import Path

import numpy as np
import pytest

from benchctl.dashboard.data.cached import ENDING, BlockFile, Cache
from benchctl_instruments.arrays import FloatArray


def _rows(count: int, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).normal(size=(count, 5))


def _kept(cache: Cache, name: str, rows: FloatArray) -> None:
    with cache.making(name) as file:
        for part in np.array_split(rows, 3):
            file.append(part)


def test_what_was_kept_is_found_under_its_name_only(tmp_path: Path) -> None:
    cache, rows = Cache(tmp_path / "not" / "there"), _rows(1000)
    assert cache.find("one") is None
    _kept(cache, "one", rows)
    found = cache.find("one")
    assert found is not None
    assert found.rows == 1000
    assert np.array_equal(found.read(10, 990), rows[10:990])
    assert cache.find("other") is None


def test_what_is_being_made_can_be_read_and_is_not_found_yet(tmp_path: Path) -> None:
    cache, rows = Cache(tmp_path), _rows(10)
    with cache.making("one") as file:
        file.append(rows)
        assert np.array_equal(file.read(2, 10), rows[2:])
        assert cache.find("one") is None
    assert np.array_equal(file.read(2, 10), rows[2:])


def test_an_error_while_it_is_made_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="shape"), Cache(tmp_path).making("one") as file:
        _append_and_fail(file)
    assert list(tmp_path.iterdir()) == []


def _append_and_fail(file: BlockFile) -> None:
    file.append(_rows(3))
    raise ValueError("the shape is wrong")


@pytest.mark.parametrize("how", ["a bit", "the head", "cut", "longer", "empty"])
def test_a_damaged_file_is_as_good_as_none(tmp_path: Path, how: str) -> None:
    cache = Cache(tmp_path)
    _kept(cache, "one", _rows(100))
    (file,) = tmp_path.glob(f"*{ENDING}")
    content = bytearray(file.read_bytes())
    damaged = {
        "a bit": content[:2000] + bytes([content[2000] ^ 1]) + content[2001:],
        "the head": bytes(16) + content[16:],
        "cut": content[:-1],
        "longer": content + b"\0",
        "empty": b"",
    }
    file.write_bytes(damaged[how])
    assert cache.find("one") is None
    _kept(cache, "one", _rows(7))
    found = cache.find("one")
    assert found is not None
    assert found.rows == 7


def test_a_file_of_another_name_in_its_place_is_not_taken_for_it(tmp_path: Path) -> None:
    cache = Cache(tmp_path)
    _kept(cache, "one", _rows(5))
    (one,) = tmp_path.glob(f"*{ENDING}")
    _kept(cache, "other", _rows(6))
    (other,) = (path for path in tmp_path.glob(f"*{ENDING}") if path != one)
    one.write_bytes(other.read_bytes())
    assert cache.find("one") is None


def test_what_was_of_no_use_for_longest_goes_first_and_what_crashes_left_goes_too(tmp_path: Path) -> None:
    cache = Cache(tmp_path, most_bytes=3 * (100 * 40 + 72))
    left = tmp_path / f".dead{ENDING}.123.tmp"
    left.write_bytes(bytes(4000))
    os.utime(left, (1, 1))
    for number, name in enumerate(("one", "two", "three")):
        _kept(cache, name, _rows(100))
        for path in set(tmp_path.glob(f"[0-9a-f]*{ENDING}")):
            if path.stat().st_mtime > 1000:
                os.utime(path, (number + 10, number + 10))
    assert not left.exists()
    assert cache.find("one") is not None  # used: it is not the oldest any more
    _kept(cache, "four", _rows(100))
    assert [cache.find(name) is not None for name in ("one", "two", "three", "four")] == [True, False, True, True]


def test_the_newest_stays_even_if_it_alone_is_too_large(tmp_path: Path) -> None:
    cache = Cache(tmp_path, most_bytes=100)
    _kept(cache, "one", _rows(100))
    _kept(cache, "two", _rows(100))
    assert cache.find("one") is None
    assert cache.find("two") is not None
