"""Work in several threads comes back in order, in bounded numbers, and its errors where they belong."""

from __future__ import annotations

import multiprocessing
import threading
import time
from collections.abc import Iterator

import pytest

from benchctl import side_by_side
from benchctl.side_by_side import cores, do_all, in_order, parts_of, shared_out, threads


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_results_come_in_the_order_of_the_items_whoever_is_first(workers: int) -> None:
    def slow_at_first(item: int) -> int:
        time.sleep(0.02 if item < 2 else 0.0)
        return item * item

    assert list(in_order(slow_at_first, range(12), workers)) == [item * item for item in range(12)]


def test_items_are_taken_only_as_far_ahead_as_there_are_threads() -> None:
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


@pytest.fixture(params=[1, 2, 4])
def several(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """So many cores, whatever the machine has."""
    monkeypatch.setattr(side_by_side, "threads", lambda: request.param)
    side_by_side._pool.cache_clear()
    yield request.param
    side_by_side._pool().shutdown()
    side_by_side._pool.cache_clear()


def test_what_is_shared_out_comes_in_the_order_of_the_items(several: int) -> None:
    def late(item: int) -> int:
        time.sleep(0.002 * (5 - item % 5))
        return item * item

    assert list(shared_out(late, range(20))) == [item * item for item in range(20)]


def test_all_is_done_for_what_it_writes(several: int) -> None:
    written = [0] * 10

    def write(place: int) -> None:
        written[place] += place

    do_all(write, range(10))
    assert written == list(range(10))


def test_no_more_is_begun_than_what_keeps_the_cores_busy(several: int) -> None:
    begun: list[int] = []
    results = shared_out(lambda item: begun.append(item), iter(range(100)))
    for _ in range(3):
        next(results)
    time.sleep(0.05)
    assert len(begun) <= 3 + several
    results.close()  # type: ignore[attr-defined]  # it is a generator
    time.sleep(0.05)
    assert len(begun) <= 3 + several


def test_an_error_of_shared_out_work_is_that_of_whoever_asked(several: int) -> None:
    def fails(item: int) -> int:
        if item == 3:
            raise ZeroDivisionError("no luck")
        return item

    results = shared_out(fails, range(10))
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ZeroDivisionError, match="no luck"):
        next(results)


def test_work_that_is_itself_shared_out_stays_in_its_thread_and_does_not_wait_for_itself(several: int) -> None:
    def inner(item: int) -> str:
        time.sleep(0.001)
        return threading.current_thread().name

    def outer(_: int) -> bool:
        return set(shared_out(inner, range(5))) == {threading.current_thread().name}

    assert all(shared_out(outer, range(4 * several)))


def test_things_in_a_row_are_parted_into_slices_of_nearly_one_size() -> None:
    assert parts_of(10, 3) == [slice(0, 3), slice(3, 6), slice(6, 10)]
    assert parts_of(2, 4) == [slice(0, 1), slice(1, 2)]
    assert parts_of(0, 4) == []


def test_few_threads_share_out() -> None:
    assert 1 <= threads() <= 4


def _squares_of_a_child() -> None:
    assert list(shared_out(lambda item: item * item, range(5))) == [0, 1, 4, 9, 16]


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="this system has no fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own() -> None:
    assert list(shared_out(str, range(5))) == list("01234")
    child = multiprocessing.get_context("fork").Process(target=_squares_of_a_child)
    child.start()
    child.join(20.0)
    alive = child.is_alive()
    child.kill()
    assert not alive
    assert child.exitcode == 0
