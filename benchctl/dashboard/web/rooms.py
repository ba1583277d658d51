"""A room for each campaign that is watched: it is read once for all its viewers.

A slow viewer gets the latest state and not the earlier ones, but every event.
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
"""Interval between two readings of a running campaign."""
QUIET_PERIOD_S = 2.0
"""Interval between two readings of another campaign: it may be resumed."""
MOST_EVENTS = 500

Frame = Mapping[str, Any]


class Viewer:
    """A client that watches: its requested channels, and the latest state to send."""

    def __init__(self) -> None:
        self.watch: Watch | None = None
        self.ended = ""
        self._frame: Frame | None = None
        self._text = ""
        self._missed: list[Any] = []
        self._news = asyncio.Event()

    def begin(self, events: Iterable[Any]) -> None:
        """Send past events with the next state."""
        self._missed = list(events)

    def offer(self, frame: Frame, text: str) -> None:
        """Set the next state to send, also as `text`; it replaces one that was not sent yet."""
        if self._frame is not None:
            self._missed = [*self._missed, *self._frame["events"]][-MOST_EVENTS:]
        self._frame, self._text = frame, text
        self._news.set()

    def end(self, reason: str) -> None:
        """Announce that no more states will follow, and why."""
        self.ended = reason or "over"
        self._news.set()

    async def next_text(self) -> str:
        """Return the next state to send, waiting for it; empty if no more will follow."""
        await self._news.wait()
        if self._frame is None:
            return ""
        frame, text, missed = self._frame, self._text, self._missed
        self._frame, self._missed = None, []
        if not self.ended:
            self._news.clear()
        return text if not missed else json_text({**frame, "events": [*missed, *frame["events"]][-MOST_EVENTS:]})


class Room:
    """The viewers of one campaign, and the task that reads it while there are any."""

    def __init__(self, follow: Callable[[], Follower], readers: Readers) -> None:
        self.is_open = True
        self._viewers: set[Viewer] = set()
        self._events: deque[Any] = deque(maxlen=FIRST_EVENTS)
        self._follow, self._readers = follow, readers
        self._task: asyncio.Task[None] | None = None

    def enter(self, viewer: Viewer) -> None:
        """Add a viewer; the first one starts the task."""
        viewer.begin(self._events)
        self._viewers.add(viewer)
        if self._task is None:
            self._task = asyncio.create_task(self._run())

    def leave(self, viewer: Viewer) -> None:
        """Remove a viewer; without viewers the room closes at the next reading."""
        self._viewers.discard(viewer)

    async def _run(self) -> None:
        message = "the server cannot follow this campaign any more"
        try:
            follower = await self._readers.run(self._follow)
            try:
                while self._viewers:
                    await self._look(follower)
            finally:
                self.is_open = False  # before any other task runs: otherwise a viewer could enter a room without a task
            await self._readers.run(follower.close)
        except (UsageError, OSError, RefusalError) as err:
            message = str(err)
        finally:
            self.is_open = False
            for viewer in self._viewers:
                viewer.end(message)

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
        await asyncio.sleep(max(took_s, period_s - took_s))  # reading takes at most half of the time


class Rooms:
    """The rooms of all campaigns with viewers."""

    def __init__(self) -> None:
        self._rooms: dict[Path, Room] = {}
        self._readers = Readers("live", threads=2, waiting=MOST_VIEWERS)
        self._count = 0

    def enter(self, path: Path, viewer: Viewer) -> Room | None:
        """Add a viewer of a campaign; return None if there are too many viewers."""
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
        """Remove a viewer."""
        self._count -= 1
        room.leave(viewer)


def _frames(follower: Follower, watches: tuple[Watch, ...]) -> dict[Watch | None, tuple[Frame, str]]:
    """Read the campaign and return the state for each watch, also as text; None: for viewers without channels."""
    found = follower.look(watches)
    series = dict(zip(watches, found["series"], strict=True))
    frames: dict[Watch | None, tuple[Frame, str]] = {}
    for watch in (None, *watches):
        frame = {**found, "series": series[watch] if watch else {}}
        frames[watch] = frame, json_text(frame)
    return frames
