"""What a crowd of clients that mean no good can do to the server, over real sockets: nothing that outlasts them."""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest

from benchctl.dashboard.web.server import STALLED_S
from tests.benchctl.dashboard.web.serving import Served, everything, serving

CROWD = 1000
LARGEST_PAGE = "/page/vendor/uPlot.iife.min.js"
GET = f"GET {LARGEST_PAGE} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode()

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a thousand sockets are too many for its select")


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    """A server of this test's own, which is still well at the end."""
    with serving(tmp_path, tmp_path) as server:
        yield server
        assert answered_after_s(server) < 10.0
        assert server.stop().count("\n") == 1
        assert server.process.returncode == 0


def silent(line: socket.socket, number: int) -> None:
    """Say nothing."""


def half_a_request(line: socket.socket, number: int) -> None:
    """Ask by halves."""
    line.sendall(b"GET /api/campaigns HTTP/1.1\r\nHost: loc")


def half_a_body(line: socket.socket, number: int) -> None:
    """Promise a body."""
    line.sendall(b"POST /api/session HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\nhalf")


def unread(line: socket.socket, number: int) -> None:
    """Ask for much and take nothing of it."""
    line.sendall(40 * GET)


def garbage(line: socket.socket, number: int) -> None:
    """Talk nonsense."""
    line.sendall(bytes((number * 7 + index) % 256 for index in range(100)))


CROWDS: tuple[Callable[[socket.socket, int], None], ...] = (silent, half_a_request, half_a_body, unread, garbage)


@pytest.mark.slow
@pytest.mark.timeout(180)
@pytest.mark.parametrize("behave", CROWDS)
def test_a_thousand_connections_are_survived_and_those_that_take_nothing_are_let_go(
    served: Served, behave: Callable[[socket.socket, int], None]
) -> None:
    before = open_sockets(served)
    with ExitStack() as stack:
        for number in range(CROWD):
            line = stack.enter_context(slow_line(served))
            with suppress(ConnectionError):  # garbage and requests above the limit are refused
                behave(line, number)
        with served.client() as client:
            assert client.get("/api/campaigns").status_code in (200, 503)
        ends_s = time.monotonic() + 3 * STALLED_S
        while behave is unread and open_sockets(served) > before:
            assert time.monotonic() < ends_s
            time.sleep(1.0)


def test_one_request_in_a_hundred_pieces_is_answered_like_any_other(served_by_all: Served) -> None:
    with served_by_all.line() as line:
        for piece in range(0, len(GET), 2):
            line.sendall(GET[piece : piece + 2])
            time.sleep(0.005)
        assert line.recv(15) == b"HTTP/1.1 200 OK"


@pytest.mark.parametrize(
    "sent",
    [
        b"\x00" * 1000,
        b"\r\n" * 10_000,
        b"GET\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET / HTTP/1.1\r\n\r\n",
        b"GET  /  HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"G\xc3\x89T / HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost : localhost\r\n\r\n",
        b"GET / HTTP/1.1\r\n Host: localhost\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nX: a\x00b\r\n\r\n",
        b"POST /api/session HTTP/1.1\r\nHost: localhost\r\nContent-Length: 3\r\nContent-Length: 4\r\n\r\nabc",
        b"POST /api/session HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nZZ\r\n",
        b"POST /api/session HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nffffffffffffffffff\r\n",
        b"POST /api/session HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: gzip\r\nContent-Length: 3\r\n\r\nabc",
        b"GET http://evil.example/ HTTP/1.1\r\nHost: evil.example\r\n\r\n",
        b"CONNECT evil.example:443 HTTP/1.1\r\nHost: evil.example:443\r\n\r\n",
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + b"\x00" * 200,
        b"GET /api/campaigns/0/live HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: h2c\r\nConnection: Upgrade, HTTP2-Settings\r\n\r\n",
        b"GET /" + b"a" * 60_000,
    ],
    ids=lambda sent: repr(sent[:30]),
)
def test_what_is_no_request_of_ours_is_refused_and_nobody_else_notices(served_by_all: Served, sent: bytes) -> None:
    with served_by_all.line() as line:
        line.sendall(sent)
        line.shutdown(socket.SHUT_WR)
        try:
            status = everything(line).partition(b"\r\n")[0]
        except ConnectionResetError:
            status = b""
    assert status == b"" or status.split(b" ")[1][:1] == b"4" or b"Upgrade: h2c" in sent, status
    assert answered_after_s(served_by_all) < 10.0


@pytest.fixture(scope="module")
def served_by_all(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A server for all the nonsense in a row."""
    folder = tmp_path_factory.mktemp("served")
    with serving(folder, folder) as server:
        yield server
        assert server.stop().count("\n") == 1


def answered_after_s(served: Served) -> float:
    """Somebody who comes now is answered, after so long."""
    began_s = time.monotonic()
    with served.client() as client:
        answer = client.get("/api/campaigns")
    assert (answer.status_code, answer.json()) == (200, {"campaigns": []})
    return time.monotonic() - began_s


@contextmanager
def slow_line(served: Served) -> Iterator[socket.socket]:
    """A connection whose end keeps little of what is sent to it."""
    with socket.socket() as line:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        line.settimeout(10.0)
        line.connect(("127.0.0.1", served.port))
        yield line


def open_sockets(served: Served) -> int:
    """How many sockets the server has open."""
    folder = f"/proc/{served.process.pid}/fd"
    if not os.path.isdir(folder):
        pytest.skip("this system does not say which files a process has open")
    links = []
    for name in os.listdir(folder):
        try:
            links.append(os.readlink(f"{folder}/{name}"))
        except OSError:  # closed meanwhile
            continue
    return sum(link.startswith("socket:") for link in links)
