"""Files of blocks in the cache: whole or not there, damaged ones are as good as none, the oldest go first."""

import os
from pathlib import Path

import numpy as np
import pytest

from benchctl.dashboard.data.cached import ENDING, Cache
from benchctl_instruments.arrays import FloatArray


def _rows(count: int, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).normal(size=(count, 5))


def test_what_was_kept_is_found_under_its_name_only(tmp_path: Path) -> None:
    cache, rows = Cache(tmp_path / "not" / "there"), _rows(1000)
    assert cache.find("one") is None
    cache.store("one", rows)
    found = cache.find("one")
    assert found is not None
    assert np.array_equal(found, rows)
    assert cache.find("other") is None


@pytest.mark.parametrize("how", ["the head", "cut", "another shape", "another type", "empty"])
def test_a_damaged_file_is_as_good_as_none(tmp_path: Path, how: str) -> None:
    cache = Cache(tmp_path)
    cache.store("one", _rows(100))
    (file,) = tmp_path.glob(f"*{ENDING}")
    content = bytearray(file.read_bytes())
    damaged = {
        "the head": bytes(16) + content[16:],
        "cut": content[:-1],
        "another shape": content.replace(b"(100, 5)", b"(125, 4)"),
        "another type": content.replace(b"<f8", b"<i8"),
        "empty": b"",
    }
    file.write_bytes(damaged[how])
    assert cache.find("one") is None
    cache.store("one", _rows(7))
    found = cache.find("one")
    assert found is not None
    assert len(found) == 7


def test_what_was_of_no_use_for_longest_goes_first_and_what_crashes_left_goes_too(tmp_path: Path) -> None:
    cache = Cache(tmp_path, most_bytes=3 * (100 * 40 + 128))
    left = tmp_path / f".dead{ENDING}.123.tmp"
    left.write_bytes(bytes(4000))
    os.utime(left, (1, 1))
    for number, name in enumerate(("one", "two", "three")):
        cache.store(name, _rows(100))
        for path in set(tmp_path.glob(f"[0-9a-f]*{ENDING}")):
            if path.stat().st_mtime > 1000:
                os.utime(path, (number + 10, number + 10))
    assert not left.exists()
    assert cache.find("one") is not None  # used: it is not the oldest any more
    cache.store("four", _rows(100))
    assert [cache.find(name) is not None for name in ("one", "two", "three", "four")] == [True, False, True, True]


def test_the_newest_stays_even_if_it_alone_is_too_large(tmp_path: Path) -> None:
    cache = Cache(tmp_path, most_bytes=100)
    cache.store("one", _rows(100))
    cache.store("two", _rows(100))
    assert cache.find("one") is None
    assert cache.find("two") is not None
