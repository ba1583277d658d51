"""Threads that are kept on a processor, those that they start, and processes that are not."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest

from benchctl.processors import only_on, set_free, several

pytestmark = pytest.mark.skipif(len(several()) < 2, reason="needs Linux and two processors")


def seen_by_a_thread() -> set[int]:
    seen: list[set[int]] = []
    thread = threading.Thread(target=lambda: seen.append(os.sched_getaffinity(0)))
    thread.start()
    thread.join()
    return seen[0]


def test_a_thread_and_what_it_starts_are_kept_on_one_processor_for_the_block() -> None:
    before = os.sched_getaffinity(0)
    chosen = several()[-1]
    with only_on(chosen):
        assert os.sched_getaffinity(0) == seen_by_a_thread() == {chosen}
        assert several() == []
    assert os.sched_getaffinity(0) == seen_by_a_thread() == before


def test_a_thread_is_let_go_of_where_the_block_fails() -> None:
    before = os.sched_getaffinity(0)
    with pytest.raises(ZeroDivisionError), only_on(several()[0]):
        1 / 0  # noqa: B018
    assert os.sched_getaffinity(0) == before


def test_a_block_that_another_thread_ends_lets_go_of_the_one_that_began_it() -> None:
    before = os.sched_getaffinity(0)
    block = only_on(several()[0])
    block.__enter__()
    other = threading.Thread(target=block.__exit__, args=(None, None, None))
    other.start()
    other.join()
    assert os.sched_getaffinity(0) == before


def test_a_process_that_is_set_free_works_wherever_the_thread_could_before() -> None:
    before = os.sched_getaffinity(0)
    asked = "import os, sys; sys.stdin.readline(); print(sorted(os.sched_getaffinity(0)))"
    with only_on(several()[0]):
        process = subprocess.Popen([sys.executable, "-c", asked], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        set_free(process.pid)
        said, _ = process.communicate(b"\n")
    assert said.decode().strip() == str(sorted(before))


def test_where_nothing_is_kept_a_process_stays_as_it_is() -> None:
    before = os.sched_getaffinity(0)
    set_free(os.getpid())
    assert os.sched_getaffinity(0) == before
