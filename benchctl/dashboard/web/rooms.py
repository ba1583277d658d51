"""Everybody who watches one campaign, in one room: it is followed once, however many there are.

A viewer who is slow gets the latest state and not those before, but every event.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from benchctl.dashboard.data.follower import FIRST_EVENTS, Follower, Watch
from benchctl.dashboard.web.answers import Readers, RefusalError, json_text
from benchctl_instruments.errors import UsageError

MOST_VIEWERS = 64
PERIOD_S = 0.25
"""Between two looks at a campaign that runs."""
QUIET_PERIOD_S = 2.0
"""Between two looks at one that does not: it may be resumed."""
MOST_EVENTS = 500

Frame = Mapping[str, Any]


class Viewer:
    """Somebody who watches: what is wanted, and the latest that is to be sent."""

    def __init__(self) -> None:
        self.watch: Watch | None = None
        self.ended = ""
        self._frame: Frame | None = None
        self._text = ""
        self._missed: list[Any] = []
        self._news = asyncio.Event()

    def begin(self, events: Iterable[Any]) -> None:
        """Give the events of before somebody came, with the next state."""
        self._missed = list(events)

    def offer(self, frame: Frame, text: str) -> None:
        """Give a state, as `text` too, in place of the one that has not been sent yet."""
        if self._frame is not None:
            self._missed = [*self._missed, *self._frame["events"]][-MOST_EVENTS:]
        self._frame, self._text = frame, text
        self._news.set()

    def end(self, says: str) -> None:
        """Tell that nothing more will come, and why."""
        self.ended = says or "over"
        self._news.set()

    async def next_text(self) -> str:
        """The next state to send, once there is one; empty where nothing more will come."""
        await self._news.wait()
        if self._frame is None:
            return ""
        frame, text, missed = self._frame, self._text, self._missed
        self._frame, self._missed = None, []
        if not self.ended:
            self._news.clear()
        return text if not missed else json_text({**frame, "events": [*missed, *frame["events"]][-MOST_EVENTS:]})


class Room:
    """The viewers of one campaign, and the task that follows it while there are any."""

    def __init__(self, follow: Callable[[], Follower], readers: Readers) -> None:
        self.is_open = True
        self._viewers: set[Viewer] = set()
        self._events: deque[Any] = deque(maxlen=FIRST_EVENTS)
        self._follow, self._readers = follow, readers
        self._task: asyncio.Task[None] | None = None

    def enter(self, viewer: Viewer) -> None:
        """Let somebody watch, and begin to follow with the first one."""
        viewer.begin(self._events)
        self._viewers.add(viewer)
        if self._task is None:
            self._task = asyncio.create_task(self._run())

    def leave(self, viewer: Viewer) -> None:
        """Let somebody go; behind the last one the room closes at the next look."""
        self._viewers.discard(viewer)

    async def _run(self) -> None:
        says = "the server cannot follow this campaign any more"
        try:
            follower = await self._readers.run(self._follow)
            try:
                while self._viewers:
                    await self._look(follower)
            finally:
                self.is_open = False  # before anything else may run: nobody enters a room that nobody follows
            await self._readers.run(follower.close)
        except (UsageError, OSError, RefusalError) as err:
            says = str(err)
        finally:
            self.is_open = False
            for viewer in self._viewers:
                viewer.end(says)

    async def _look(self, follower: Follower) -> None:
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        watches = tuple({viewer.watch: None for viewer in self._viewers if viewer.watch})
        frames = await self._readers.run(lambda: _frames(follower, watches))
        self._events += frames[None][0]["events"]
        for viewer in self._viewers:
            viewer.offer(*frames.get(viewer.watch, frames[None]))
        took_s = loop.time() - began_s
        period_s = PERIOD_S if frames[None][0]["status"] == "running" else QUIET_PERIOD_S
        await asyncio.sleep(max(took_s, period_s - took_s))  # looking never takes more than half of the time


class Rooms:
    """The rooms of all campaigns that somebody watches."""

    def __init__(self) -> None:
        self._rooms: dict[Path, Room] = {}
        self._readers = Readers("live", threads=2, waiting=MOST_VIEWERS)
        self._count = 0

    def enter(self, path: Path, viewer: Viewer) -> Room | None:
        """Let somebody watch a campaign; None where there are too many viewers."""
        if self._count >= MOST_VIEWERS:
            return None
        self._count += 1
        room = self._rooms.get(path)
        if room is None or not room.is_open:
            self._rooms = {other: room for other, room in self._rooms.items() if room.is_open}
            room = self._rooms[path] = Room(lambda: Follower(path), self._readers)
        room.enter(viewer)
        return room

    def leave(self, room: Room, viewer: Viewer) -> None:
        """Somebody who had entered goes."""
        self._count -= 1
        room.leave(viewer)


def _frames(follower: Follower, watches: tuple[Watch, ...]) -> dict[Watch | None, tuple[Frame, str]]:
    """One look, and for each watch its state, as text too; None: for those who watch no channels yet."""
    found = follower.look(watches)
    series = dict(zip(watches, found["series"], strict=True))
    frames: dict[Watch | None, tuple[Frame, str]] = {}
    for watch in (None, *watches):
        frame = {**found, "series": series[watch] if watch else {}}
        frames[watch] = frame, json_text(frame)
    return frames
