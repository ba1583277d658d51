"""What the readers' limits say to those who pass them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.limits import cut, listed, read_whole, require_file, require_memory, shown
from benchctl_instruments.errors import UsageError


def test_a_file_is_read_up_to_its_limit_and_not_beyond(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(b"x" * 10)
    assert read_whole(path, 10, "map file ") == b"x" * 10
    with pytest.raises(UsageError, match=r"map file .*a\.toml: is larger than"):
        read_whole(path, 9, "map file ")


def test_a_device_that_never_ends_is_not_read() -> None:
    with pytest.raises(UsageError, match="cannot be read: it is no file"):
        read_whole(Path("/dev/zero"), 1 << 20, "bench ")


@pytest.mark.parametrize("name", ["a\0b", "no/such/file"])
def test_a_name_that_no_file_has_is_refused_in_words(name: str) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        read_whole(Path(name), 100, "bench ")


def test_a_pipe_is_no_file_and_a_link_to_a_file_is_one(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(UsageError, match="it is no file"):
        require_file(tmp_path / "pipe")
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to(tmp_path / "file")
    require_file(tmp_path / "link")


def test_what_no_machine_holds_is_refused_before_it_is_allocated() -> None:
    require_memory(Path("a.h5"), 1 << 20, "step 1")
    with pytest.raises(UsageError, match=r"a\.h5: step 1 needs 1\.15e\+09 GB of memory, this machine has"):
        require_memory(Path("a.h5"), 1 << 60, "step 1")


@settings(max_examples=50, deadline=None)
@given(st.recursive(st.none() | st.integers() | st.text(), st.lists) | st.just(1 << 100_000))
def test_whatever_a_file_says_is_shown_in_sixty_characters(value: object) -> None:
    assert 0 < len(shown(value)) <= 60


def test_a_nesting_that_python_does_not_print_is_shown_by_its_kind() -> None:
    value: list[object] = []
    for _ in range(100_000):
        value = [value]
    assert shown(value) == "a list too large to be shown"


def test_long_texts_and_lists_are_cut() -> None:
    assert cut("x" * 500) == "x" * 500
    assert cut("x" * 501) == "x" * 497 + "..."
    assert listed(["a", "b"]) == "a, b"
    assert listed([str(k) for k in range(30)]).endswith("18, 19, and 10 more")
