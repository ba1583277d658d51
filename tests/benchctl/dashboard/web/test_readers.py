import asyncio
import threading
import time

import pytest

from benchctl.dashboard.web.answers import Readers, RefusalError


def test_who_asks_gets_what_the_job_returns_or_raises() -> None:
    async def ask() -> None:
        readers = Readers("test", threads=1, waiting=4)
        assert await readers.run(lambda: 7) == 7
        with pytest.raises(ZeroDivisionError):
            await readers.run(lambda: 1 // 0)
        assert await readers.run(lambda: threading.current_thread().name) == "test-0"

    asyncio.run(ask())


def test_beyond_those_that_run_and_wait_everybody_is_refused_at_once_and_the_loop_goes_on() -> None:
    release = threading.Event()

    async def ask() -> None:
        readers = Readers("test", threads=2, waiting=3)
        running = [asyncio.create_task(readers.run(release.wait)) for _ in range(2)]
        await asyncio.sleep(0.1)
        waiting = [asyncio.create_task(readers.run(lambda: True)) for _ in range(3)]
        await asyncio.sleep(0)
        with pytest.raises(RefusalError, match="too many requests at once") as caught:
            await readers.run(lambda: True)
        assert caught.value.status == 503
        release.set()
        assert await asyncio.gather(*running, *waiting) == [True] * 5

    asyncio.run(ask())


def test_who_waits_too_long_is_told_so_and_the_job_that_nobody_waits_for_is_never_begun() -> None:
    release, begun = threading.Event(), []

    async def ask() -> None:
        readers = Readers("test", threads=1, waiting=4, within_s=0.2)
        running = asyncio.create_task(readers.run(release.wait))
        await asyncio.sleep(0.05)
        with pytest.raises(RefusalError):
            await readers.run(lambda: begun.append("late"))
        with pytest.raises(RefusalError):
            await running
        release.set()
        await readers.run(lambda: begun.append("next"))

    asyncio.run(ask())
    assert begun == ["next"]


def test_a_job_that_never_ends_does_not_keep_the_loop_from_ending() -> None:
    async def ask() -> None:
        readers = Readers("test", threads=1, waiting=1, within_s=0.1)
        with pytest.raises(RefusalError):
            await readers.run(threading.Event().wait)

    began_s = time.monotonic()
    asyncio.run(ask())
    assert time.monotonic() - began_s < 5.0


def test_a_cancellation_is_not_lost_when_the_result_arrives_at_the_same_moment() -> None:
    release, begun = threading.Event(), threading.Event()

    def job() -> bool:
        begun.set()
        return release.wait()

    async def ask() -> None:
        readers = Readers("test", threads=1, waiting=1)
        task = asyncio.create_task(readers.run(job))
        await asyncio.to_thread(begun.wait)
        release.set()
        time.sleep(0.2)  # the loop is busy: the result waits in its queue, before the cancellation
        asyncio.get_running_loop().call_soon(task.cancel)
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(ask())
