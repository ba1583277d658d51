import asyncio
import json
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchctl.dashboard.data.follower import Follower, Watch
from benchctl.dashboard.web.answers import Readers
from benchctl.dashboard.web.rooms import MOST_EVENTS, MOST_VIEWERS, Room, Rooms, Viewer
from benchctl_instruments.errors import UsageError

GYRO = Watch(("gyro_v",), 60.0, 100)
RATE = Watch(("rate_dps",), 60.0, 100)


class Counting(Follower):
    """A follower of nothing that counts what is asked of it."""

    def __init__(self, status: str = "running", fails_at: int = 0) -> None:
        self.looks: list[tuple[Watch, ...]] = []
        self.closed = 0
        self._status, self._fails_at = status, fails_at

    def look(self, watches: Sequence[Watch] = ()) -> dict[str, Any]:
        self.looks.append(tuple(watches))
        if len(self.looks) == self._fails_at:
            raise UsageError("the disk is gone")
        series = [{channel: {"t_s": [1.0]} for channel in watch.channels} for watch in watches]
        return {"status": self._status, "events": [{"number": len(self.looks)}], "series": series}

    def close(self) -> None:
        self.closed += 1


def room_of(follower: Follower) -> Room:
    return Room(lambda: follower, Readers("test", threads=1, waiting=8))


def frame(*numbers: int) -> dict[str, Any]:
    return {"status": "running", "events": [{"number": number} for number in numbers]}


def test_a_slow_viewer_gets_the_latest_state_and_every_event() -> None:
    async def take() -> dict[str, Any]:
        viewer = Viewer()
        for made in (frame(1, 2), frame(), {**frame(3), "status": "complete"}):
            viewer.offer(made, json.dumps(made))
        taken: dict[str, Any] = json.loads(await viewer.next_text())
        return taken

    assert asyncio.run(take()) == {
        "status": "complete",
        "events": [{"number": number} for number in (1, 2, 3)],
    }


def test_what_a_viewer_keeps_waiting_does_not_grow() -> None:
    async def take() -> list[dict[str, int]]:
        viewer = Viewer()
        for number in range(5 * MOST_EVENTS):
            viewer.offer(frame(number), json.dumps(frame(number)))
        events: list[dict[str, int]] = json.loads(await viewer.next_text())["events"]
        return events

    events = asyncio.run(take())
    assert len(events) == MOST_EVENTS
    assert events[-1] == {"number": 5 * MOST_EVENTS - 1}


def test_a_viewer_waits_for_news_and_takes_them_once() -> None:
    async def take() -> None:
        viewer = Viewer()
        waiting = asyncio.create_task(viewer.next_text())
        await asyncio.sleep(0.01)
        assert not waiting.done()
        viewer.offer(frame(1), "one")
        assert await waiting == "one"
        again = asyncio.create_task(viewer.next_text())
        await asyncio.sleep(0.01)
        assert not again.done()
        viewer.end("over")
        assert await again == ""

    asyncio.run(take())


def test_many_viewers_cost_one_look_and_equal_watches_are_computed_once() -> None:
    follower = Counting()

    async def watch() -> list[str]:
        room = room_of(follower)
        viewers = [Viewer() for _ in range(10)]
        for number, viewer in enumerate(viewers):
            viewer.watch = GYRO if number < 6 else RATE
            room.enter(viewer)
        texts = [await viewer.next_text() for viewer in viewers]
        for viewer in viewers:
            room.leave(viewer)
        await until_closed(room, follower)
        return texts

    texts = asyncio.run(watch())
    assert {frozenset(watches) for watches in follower.looks[:1]} == {frozenset({GYRO, RATE})}
    assert len(follower.looks[0]) == 2
    assert len(follower.looks) <= 3
    assert [list(json.loads(text)["series"]) for text in texts] == [["gyro_v"]] * 6 + [["rate_dps"]] * 4


def test_who_comes_later_gets_the_latest_events_too() -> None:
    async def watch() -> tuple[list[Any], list[Any]]:
        room, first, second = room_of(Counting()), Viewer(), Viewer()
        room.enter(first)
        await first.next_text()
        before = json.loads(await first.next_text())["events"]
        room.enter(second)
        told = json.loads(await second.next_text())["events"]
        room.leave(first)
        room.leave(second)
        return before, told

    before, told = asyncio.run(watch())
    assert before == [{"number": 2}]
    assert told == [{"number": 1}, {"number": 2}, {"number": 3}]


def test_a_viewer_who_watches_no_channel_gets_the_state_without_series() -> None:
    async def watch() -> dict[str, Any]:
        viewer = Viewer()
        room_of(Counting()).enter(viewer)
        said: dict[str, Any] = json.loads(await viewer.next_text())
        return said

    assert asyncio.run(watch())["series"] == {}


def test_a_running_campaign_is_looked_at_four_times_a_second_and_another_seldom() -> None:
    running, over = Counting(), Counting(status="complete")

    async def watch() -> None:
        for follower in (running, over):
            room_of(follower).enter(Viewer())
        await asyncio.sleep(1.1)

    asyncio.run(watch())
    assert 3 <= len(running.looks) <= 5
    assert len(over.looks) == 1


def test_nobody_is_followed_once_the_last_viewer_has_gone() -> None:
    follower = Counting()

    async def watch() -> None:
        room, viewer = room_of(follower), Viewer()
        room.enter(viewer)
        await viewer.next_text()
        room.leave(viewer)
        await until_closed(room, follower)
        looks = len(follower.looks)
        await asyncio.sleep(0.6)
        assert len(follower.looks) == looks

    asyncio.run(watch())
    assert follower.closed == 1


def test_viewers_are_told_why_a_campaign_cannot_be_followed_any_more() -> None:
    async def watch() -> str:
        viewer = Viewer()
        room_of(Counting(fails_at=2)).enter(viewer)
        assert await viewer.next_text()
        assert await viewer.next_text() == ""
        return viewer.ended

    assert asyncio.run(watch()) == "the disk is gone"


def test_of_more_viewers_than_there_is_room_for_the_last_is_refused_until_one_goes(tmp_path: Path) -> None:
    async def crowd() -> None:
        rooms = Rooms()
        viewers = [Viewer() for _ in range(MOST_VIEWERS)]
        entered = [rooms.enter(tmp_path, viewer) for viewer in viewers]
        assert len(set(map(id, entered))) == 1
        assert rooms.enter(tmp_path / "another", Viewer()) is None
        assert entered[0] is not None
        rooms.leave(entered[0], viewers[0])
        assert rooms.enter(tmp_path, Viewer()) is entered[0]

    asyncio.run(crowd())


async def until_closed(room: Room, follower: Counting) -> None:
    async with asyncio.timeout(5.0):
        while room.is_open or not follower.closed:
            await asyncio.sleep(0.02)
    assert threading.active_count() < 50
