"""`WS /api/campaigns/{id}/live`: the state of a campaign, up to four times a second."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Annotated

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect

from benchctl.dashboard.data.follower import Watch
from benchctl.dashboard.web.access import Caller, CallerOf
from benchctl.dashboard.web.rooms import Viewer
from benchctl.dashboard.web.site import Site, SiteOf

MOST_MESSAGE_BYTES = 4 << 10
TAKEN_WITHIN_S = 20.0
_PAUSE_S = 0.05
"""Pause between two messages read from one viewer."""
_GOODBYE_WITHIN_S = 2.0
_POLICY, _TROUBLE, _LATER = 1008, 1011, 1013
_LONGEST_REASON = 120
"""Bytes; a websocket's close frame holds 123."""

Goodbye = tuple[int, str]
"""Code and reason."""

Channel = Annotated[str, Field(pattern="^[A-Za-z][A-Za-z0-9_]{0,63}$")]


class Wish(BaseModel):
    """The channels that a viewer requests."""

    model_config = ConfigDict(extra="forbid")
    channels: list[Channel] = Field(max_length=16)
    window_s: float = Field(gt=0, le=1e9, allow_inf_nan=False)
    pixels: int = Field(ge=1, le=4000)


class WishMessage(BaseModel):
    """A message from a viewer."""

    model_config = ConfigDict(extra="forbid")
    watch: Wish


router = APIRouter()


@router.websocket("/api/campaigns/{key}/live")
async def live(socket: WebSocket, key: str, site: SiteOf, caller: CallerOf) -> None:
    """Send a campaign's state until the viewer disconnects, logs out, or stops reading."""
    path = await site.quick.run(lambda: site.path_of(key))
    await socket.accept()
    viewer = Viewer()
    room = site.rooms.enter(path, viewer)
    if room is None:
        await socket.close(_LATER, "too many watch already; try again later")
        return
    ends = {asyncio.create_task(_hear(socket, viewer)), asyncio.create_task(_tell(socket, viewer, site, caller))}
    try:
        done, _ = await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
    finally:
        site.rooms.leave(room, viewer)
        for task in ends:
            task.cancel()
    if goodbye := done.pop().result():
        with suppress(TimeoutError, WebSocketDisconnect):
            await asyncio.wait_for(socket.close(*goodbye), _GOODBYE_WITHIN_S)


async def _hear(socket: WebSocket, viewer: Viewer) -> Goodbye | None:
    """Receive the viewer's requests; return the code and reason for closing, None if the viewer has disconnected."""
    try:
        while True:
            wish = WishMessage.model_validate_json(await socket.receive_text()).watch
            viewer.watch = Watch(tuple(dict.fromkeys(wish.channels)), wish.window_s, wish.pixels)
            await asyncio.sleep(_PAUSE_S)
    except WebSocketDisconnect:
        return None
    except (ValidationError, KeyError):  # KeyError: bytes
        return _POLICY, 'expected {"watch": {"channels": […], "window_s": …, "pixels": …}}'


async def _tell(socket: WebSocket, viewer: Viewer, site: Site, caller: Caller) -> Goodbye | None:
    """Send new states; return the code and reason for closing, None if the viewer is gone or stopped reading."""
    try:
        while text := await viewer.next_text():
            if caller.secret is not None and site.sessions.find(caller.secret) is None:
                return _POLICY, "the session is over; log in again"
            await asyncio.wait_for(socket.send_text(text), TAKEN_WITHIN_S)
    except (WebSocketDisconnect, TimeoutError):
        return None
    return _TROUBLE, viewer.ended.encode()[:_LONGEST_REASON].decode(errors="ignore")
