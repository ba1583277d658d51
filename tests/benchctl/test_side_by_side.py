"""Work in several threads comes back in order, in bounded numbers, and its errors where they belong."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from benchctl.side_by_side import cores, in_order


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_results_come_in_the_order_of_the_items_whoever_is_first(workers: int) -> None:
    def slow_at_first(item: int) -> int:
        time.sleep(0.02 if item < 2 else 0.0)
        return item * item

    assert list(in_order(slow_at_first, range(12), workers)) == [item * item for item in range(12)]


def test_items_are_taken_only_as_far_ahead_as_there_are_workers() -> None:
    taken: list[int] = []

    def items() -> Iterator[int]:
        for item in range(100):
            taken.append(item)
            yield item

    results = in_order(lambda item: item, items(), 2)
    for expected in range(10):
        assert next(results) == expected
        assert len(taken) <= expected + 4
    results.close()


def test_they_do_run_at_the_same_time() -> None:
    meeting = threading.Barrier(3, timeout=30)
    assert sorted(in_order(lambda _: meeting.wait(), range(3), 3)) == [0, 1, 2]


def test_an_error_comes_after_the_results_before_it_and_ends_the_rest() -> None:
    begun: list[int] = []

    def work(item: int) -> int:
        begun.append(item)
        if item == 3:
            raise ValueError("the third")
        return item

    results = in_order(work, range(1000), 2)
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ValueError, match="the third"):
        next(results)
    assert len(begun) < 10
    assert not any(thread.name.startswith("side_by_side") for thread in threading.enumerate())


def test_there_is_a_core_to_work_on() -> None:
    assert cores() >= 1
