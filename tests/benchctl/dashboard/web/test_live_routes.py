"""The websocket of a campaign, over real sockets."""

from __future__ import annotations

import asyncio
import json
import socket
import statistics
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection

from benchctl.dashboard.web.live_routes import MOST_MESSAGE_BYTES
from benchctl.dashboard.web.rooms import MOST_VIEWERS
from benchctl.dashboard.web.server import STALLED_S
from tests.benchctl.dashboard.web.conftest import OVER, RUNNING
from tests.benchctl.dashboard.web.serving import Served

WATCH = {"watch": {"channels": ["gyro_v", "rate_dps"], "window_s": 600, "pixels": 50}}


@pytest.fixture
def running(served: Served) -> str:
    """The id of the campaign that is being written."""
    return served.key_of(RUNNING)


def refusal(served: Served, key: str, token: str | None = "", **headers: str) -> int:
    """The status with which a websocket is refused."""
    with pytest.raises(InvalidStatus) as caught, served.watch(key, token, headers=headers):
        pass
    assert list(json.loads(caught.value.response.body)) == ["error"]
    return caught.value.response.status_code


def test_a_viewer_sees_the_run_and_the_channels_that_are_wanted(served: Served, running: str) -> None:
    with served.watch(running, served.view_token) as viewer:
        first = json.loads(viewer.recv(timeout=10))
        assert (first["status"], first["series"]) == ("running", {})
        viewer.send(json.dumps(WATCH))
        while not (said := json.loads(viewer.recv(timeout=10)))["series"]:
            pass
    assert set(said["series"]) == {"gyro_v", "rate_dps"}
    assert set(said["series"]["gyro_v"]) == {"t_s", "low", "high"}
    assert len(said["series"]["gyro_v"]["t_s"]) > 0


def test_a_running_campaign_is_told_of_four_times_a_second_at_most(served: Served, running: str) -> None:
    with served.watch(running) as viewer:
        viewer.recv(timeout=10)
        began_s = time.monotonic()
        for _ in range(8):
            viewer.recv(timeout=10)
        assert time.monotonic() - began_s > 8 * 0.25 - 0.3


def test_the_pages_own_session_opens_it_with_the_pages_own_origin_only(served: Served, running: str) -> None:
    with served.browser(served.view_token) as (client, _):
        cookie = f"benchctl_{served.port}={client.cookies[f'benchctl_{served.port}']}"
        own = {"Cookie": cookie, "Origin": f"http://127.0.0.1:{served.port}"}
        with served.watch(running, None, headers=own) as viewer:
            assert json.loads(viewer.recv(timeout=10))["status"] == "running"
        for origin in ("http://evil.example", "null", "http://127.0.0.1:1"):
            assert refusal(served, running, None, Cookie=cookie, Origin=origin) == 403


def test_strangers_are_refused_before_anything_is_said(served: Served, running: str) -> None:
    assert refusal(served, running, None) == 401
    assert refusal(served, running, f"{served.token}x") == 401
    assert refusal(served, running, None, Authorization=f"Basic {served.token}") == 401
    assert refusal(served, running, None, Cookie=f"benchctl_{served.port}={served.token}") == 401
    assert refusal(served, running, Origin="http://evil.example") == 403


@pytest.mark.parametrize("key", ["0123456789abcdef", "x", "%2e%2e", "..%2f..%2fetc", "%00"])
def test_a_campaign_that_is_not_there_cannot_be_watched(served: Served, key: str) -> None:
    with pytest.raises(InvalidStatus) as caught, served.watch(key):
        pass
    assert caught.value.response.status_code in (403, 404)


@pytest.mark.parametrize(
    "sent",
    [
        "",
        "null",
        "{}",
        "[]",
        '{"watch": null}',
        '{"watch": {"channels": [], "window_s": 0, "pixels": 10}}',
        '{"watch": {"channels": [], "window_s": NaN, "pixels": 10}}',
        '{"watch": {"channels": [], "window_s": 1e999, "pixels": 10}}',
        '{"watch": {"channels": [], "window_s": 10, "pixels": 4001}}',
        '{"watch": {"channels": ["../gyro_v"], "window_s": 10, "pixels": 10}}',
        '{"watch": {"channels": ["a"], "window_s": 10, "pixels": 10}, "more": 1}',
        json.dumps({"watch": {"channels": ["a"] * 17, "window_s": 10, "pixels": 10}}),
        "[" * 4000,
        b"\x00\x01",
        b'{"watch": {"channels": [], "window_s": 10, "pixels": 10}}',
    ],
    ids=lambda sent: repr(sent[:40]),
)
def test_a_message_that_is_no_wish_ends_the_websocket_and_says_what_was_expected(
    served: Served, running: str, sent: str | bytes
) -> None:
    with served.watch(running) as viewer:
        viewer.send(sent)
        assert ending(viewer)[0] == 1008
        assert '{"watch":' in ending(viewer)[1]


def test_a_channel_that_the_campaign_does_not_have_harms_nobody(served: Served, running: str) -> None:
    wish = {"watch": {"channels": ["no_such_channel", "gyro_v"], "window_s": 600, "pixels": 50}}
    with served.watch(running) as viewer:
        viewer.send(json.dumps(wish))
        while "gyro_v" not in (said := json.loads(viewer.recv(timeout=10)))["series"]:
            pass
    assert len(said["series"]["gyro_v"]["t_s"]) > 0


def test_a_message_that_is_too_large_ends_the_websocket(served: Served, running: str) -> None:
    with served.watch(running) as viewer:
        viewer.send("x" * (MOST_MESSAGE_BYTES + 1))
        assert ending(viewer)[0] == 1009


def test_a_message_in_many_parts_is_too_large_as_well(served: Served, running: str) -> None:
    def send_and_listen(viewer: ClientConnection) -> None:
        viewer.send("x" * 1000 for _ in range(1000))
        deque(iter(lambda: viewer.recv(timeout=10), None), maxlen=0)  # the last part may be faster than the refusal

    with served.watch(running) as viewer, pytest.raises(ConnectionClosed):
        send_and_listen(viewer)
    with served.watch(running) as viewer:
        assert json.loads(viewer.recv(timeout=10))["status"] == "running"


def test_who_logs_out_sees_no_more(served: Served, running: str) -> None:
    with served.browser() as (client, csrf):
        cookie = f"benchctl_{served.port}={client.cookies[f'benchctl_{served.port}']}"
        with served.watch(running, None, headers={"Cookie": cookie}) as viewer:
            viewer.recv(timeout=10)
            client.delete("/api/session", headers={"X-CSRF": csrf})
            assert ending(viewer) == (1008, "the session is over; log in again")


def test_a_campaign_that_is_over_is_told_of_too(served: Served) -> None:
    with served.watch(served.key_of(OVER)) as viewer:
        assert json.loads(viewer.recv(timeout=10))["status"] == "complete"


def test_beyond_the_most_viewers_the_next_is_told_to_come_again(served: Served, running: str) -> None:
    with ExitStack() as stack:
        for _ in range(MOST_VIEWERS):
            stack.enter_context(served.watch(running))
        with served.watch(running) as viewer:
            assert ending(viewer)[0] == 1013
    time.sleep(0.5)
    with served.watch(running) as viewer:
        assert json.loads(viewer.recv(timeout=10))["status"] == "running"


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_viewers_that_never_read_are_let_go_and_hold_nobody_up(served: Served, running: str) -> None:
    waited_s = []
    with ExitStack() as stack:
        lines = [stack.enter_context(deaf_viewer(served, running)) for _ in range(10)]
        ends_s = time.monotonic() + 4 * STALLED_S
        alive = set(lines)
        while alive:
            began_s = time.monotonic()
            with served.client() as client:
                assert client.get("/api/campaigns").status_code == 200
            waited_s.append(time.monotonic() - began_s)
            alive = {line for line in alive if is_open(line)}
            assert time.monotonic() < ends_s, f"{len(alive)} are still there"
            time.sleep(1.0)
    assert statistics.median(waited_s) < 1.0
    assert max(waited_s) < 10.0  # others use this machine, too


@pytest.mark.slow
def test_ten_viewers_at_once_all_see_it_four_times_a_second(served: Served, running: str) -> None:
    async def watch() -> int:
        headers = {"Authorization": f"Bearer {served.view_token}"}
        url = f"ws://127.0.0.1:{served.port}/api/campaigns/{running}/live"
        async with connect(url, additional_headers=headers, proxy=None) as viewer:
            await viewer.send(json.dumps(WATCH))
            ends_s = time.monotonic() + 5.0
            count = 0
            while time.monotonic() < ends_s:
                await viewer.recv()
                count += 1
            return count

    async def crowd() -> list[int]:
        return await asyncio.gather(*(watch() for _ in range(10)))

    assert min(asyncio.run(crowd())) >= 12


def ending(viewer: ClientConnection) -> tuple[int, str]:
    """With which code and reason the server ends it."""
    with pytest.raises(ConnectionClosed) as caught:
        deque(iter(lambda: viewer.recv(timeout=10), None), maxlen=0)
    assert caught.value.rcvd is not None
    return caught.value.rcvd.code, caught.value.rcvd.reason


@contextmanager
def deaf_viewer(served: Served, key: str) -> Iterator[socket.socket]:
    """A websocket that wants much and reads nothing, not even the answer to its opening."""
    with socket.socket() as line:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        line.connect(("127.0.0.1", served.port))
        line.sendall(
            (
                f"GET /api/campaigns/{key}/live HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n"
                f"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {'A' * 22}==\r\n"
                f"Authorization: Bearer {served.token}\r\n\r\n"
            ).encode()
        )
        wish = json.dumps({"watch": {"channels": ["gyro_v"], "window_s": 600, "pixels": 4000}}).encode()
        line.sendall(bytes([0x81, 0x80 | len(wish), 0, 0, 0, 0]) + wish)
        yield line


def is_open(line: socket.socket) -> bool:
    """Whether the server still has the other end; nothing is read."""
    try:
        line.sendall(bytes([0x8A, 0x80, 0, 0, 0, 0]))  # a pong that nobody asked for
    except OSError:
        return False
    return True
