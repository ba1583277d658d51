"""One process that serves the live page until it receives a signal."""

from __future__ import annotations

import asyncio
import errno
import importlib
import ipaddress
import logging
import os
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import uvicorn
from starlette.types import ASGIApp
from uvicorn.server import ServerState

import benchctl
from benchctl.app.station import Station
from benchctl.campaign.stop import StopRequest, stop_on_signals
from benchctl.confined import confine
from benchctl.dashboard.data.catalogue import Catalogue
from benchctl.dashboard.data.contents import cache_folder
from benchctl.dashboard.data.series import SeriesReader
from benchctl.dashboard.web.answers import Readers, RefusalError
from benchctl.dashboard.web.app import page_app
from benchctl.dashboard.web.gate import MOST_HEADER_BYTES, is_loopback, own_names
from benchctl.dashboard.web.live_routes import MOST_MESSAGE_BYTES
from benchctl.dashboard.web.sessions import Tokens
from benchctl.dashboard.web.site import Explain, Glossary, Site
from benchctl_instruments.errors import UsageError

STALLED_S = 20.0
"""Time after which a connection is closed if the client does not read what is sent to it."""
_MOST_CONNECTIONS = 512
"""Number of open connections from which requests are refused (503); `MOST_VIEWERS` browsers open 7 each."""
_SEND_BUFFER_BYTES = 256 << 10
"""Size of the system's send buffer: enough for a fast reader, small for many slow ones."""
_GOODBYE_S = 0.5
"""Time for clients to read their responses when the server ends."""
_IDLE_S = 20
"""Longest time between two requests on a connection."""
_PING_EVERY_S, _PONG_WITHIN_S = 5.0, STALLED_S - 5.0
_ADVANCE_EVERY_S = 1.0
"""Time between two looks whether the run is over and the next one may start."""
_REFUSED_WEBSOCKET = "ASGI callable returned without completing handshake."
"""What uvicorn logs as an error for every refused websocket."""


def listening(host: str, port: int) -> socket.socket:
    """Return a listening socket; port 0 selects a free one. Raises `UsageError` if that is impossible."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        sock = socket.socket(family, kind, protocol)
    except OSError as err:
        raise UsageError(f"--host {host}: is no address of this machine: {err.strerror or err}") from err
    try:
        if sys.platform != "win32":  # there it would let two programs share the port
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        sock.bind(address)
        sock.listen()
    except OSError as err:
        sock.close()
        if err.errno == errno.EADDRINUSE:
            raise UsageError(
                f"--port {port}: is in use by another program on {host}; name another, or 0 for any that is free"
            ) from err
        raise UsageError(f"cannot listen at {host} port {port}: {err.strerror or err}; name another") from err
    return sock


def lower_priority() -> None:
    """Give a run on the same machine priority, if the system supports it."""
    if hasattr(os, "nice"):
        os.nice(5)


def serve_until(stop: StopRequest, app: ASGIApp, sock: socket.socket, ready: Callable[[], None], site: Site) -> None:
    """Serve on a socket until a stop is requested; `ready` is called when requests can be served."""
    logging.getLogger("uvicorn").addHandler(logging.StreamHandler())
    logging.getLogger("uvicorn.error").addFilter(lambda record: record.msg != _REFUSED_WEBSOCKET)
    config = uvicorn.Config(
        app,
        http="h11",
        ws="websockets-sansio",
        lifespan="off",
        log_config=None,
        log_level="error",
        access_log=False,
        proxy_headers=False,
        server_header=False,
        backlog=128,  # also the maximum of new connections in one iteration of the event loop
        limit_concurrency=_MOST_CONNECTIONS,
        h11_max_incomplete_event_size=MOST_HEADER_BYTES,
        timeout_keep_alive=_IDLE_S,
        timeout_graceful_shutdown=1,
        ws_max_size=MOST_MESSAGE_BYTES,
        ws_ping_interval=_PING_EVERY_S,
        ws_ping_timeout=_PONG_WITHIN_S,
        ws_per_message_deflate=False,  # a small message cannot become a large one
    )
    asyncio.run(_serve(_Server(config), stop, sock, ready, site))


class _Server(uvicorn.Server):
    """A server that does not handle signals."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Do nothing: `StopRequest` handles signals."""
        yield


async def _serve(
    server: _Server, stop: StopRequest, sock: socket.socket, ready: Callable[[], None], site: Site
) -> None:
    serving = asyncio.create_task(server.serve([sock]))
    meanwhile = [asyncio.create_task(_close_stalled(server.server_state)), asyncio.create_task(_advance(site))]
    while not server.started and not serving.done():
        await asyncio.sleep(0.01)
    ready()
    while not stop.reason and not serving.done():
        await asyncio.sleep(0.1)
    logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)  # cutting off readers is expected here
    server.should_exit = True
    await asyncio.wait({serving}, timeout=_GOODBYE_S)
    server.force_exit = True
    await serving
    for task in meanwhile:
        task.cancel()


async def _advance(site: Site) -> None:
    """Let the station's queue go on, again and again; runs until cancelled."""
    while site.station is not None:
        with suppress(RefusalError, UsageError, OSError):  # a full disk, or many orders at once: the next time
            await site.starting.run(site.station.advance)
        await asyncio.sleep(_ADVANCE_EVERY_S)


async def _close_stalled(state: ServerState) -> None:
    """Close connections of which no byte was read for `STALLED_S`, looking once a second; runs until cancelled."""
    unsent: dict[object, tuple[int, float]] = {}  # the bytes of a connection, and since when they are the same
    while True:
        now_s = asyncio.get_running_loop().time()
        before, unsent = unsent, {}
        for connection in list(state.connections):
            size = connection.transport.get_write_buffer_size()
            last_size, since_s = before.get(connection, (0, now_s))
            unsent[connection] = size, since_s if size == last_size else now_s
            if size and now_s - unsent[connection][1] > STALLED_S:
                connection.transport.abort()
        await asyncio.sleep(1.0)


def run_page(
    root: Path,
    host: str,
    port: int,
    *,
    read_only: bool,
    station: Station | None,
    explain: Explain,
    glossary: Glossary,
    ready: Callable[[str, Tokens], None],
    warn: Callable[[str], None],
) -> None:
    """Serve the campaigns below `root` until Ctrl-C or SIGTERM.

    `ready` is called with the address and the tokens when requests can be served; `warn` is called
    earlier with security warnings. After the start the process opens no files outside `root` (`benchctl.confined`).
    Raises `UsageError` if the port is not available.
    """
    starting = Readers("starting", threads=1, waiting=4, within_s=150.0)
    lower_priority()  # of this thread and all threads that it starts from now on, so not of the runs of `starting`
    root, cache, tokens = root.resolve(), cache_folder(), Tokens(read_only=read_only)
    confine(root, cache, Path(benchctl.__file__).parent)
    with stop_on_signals() as stop, listening(host, port) as sock, SeriesReader(cache) as series:
        bound_port = sock.getsockname()[1]
        if not is_loopback(host):
            warn(
                f"--host {host}: the link is not encrypted, others can read on it, tokens too; safer: leave --host out "
                f"and, from the other machine, ssh -L {bound_port}:127.0.0.1:{bound_port} to this one"
            )
        site = Site(
            root=root,
            cache=cache,
            tokens=tokens,
            cookie=f"benchctl_{bound_port}",
            explain=explain,
            glossary=glossary,
            catalogue=Catalogue(root, cache),
            series=series,
            station=station,
            starting=starting,
        )

        def tell_ready() -> None:
            ready(_url(host, bound_port), tokens)
            threading.Thread(target=_warm_up, daemon=True).start()

        serve_until(stop, page_app(site, own_names(host)), sock, tell_ready, site)


def _warm_up() -> None:
    """Import modules for the first reading of a run in advance, because it takes seconds."""
    importlib.import_module("benchctl.campaign.provenance")


def _url(host: str, port: int) -> str:
    """Return the address of the page for a browser on this machine."""
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return f"http://{host}:{port}/"
    if address.is_unspecified:
        return f"http://127.0.0.1:{port}/" if address.version == 4 else f"http://[::1]:{port}/"
    return f"http://{address}:{port}/" if address.version == 4 else f"http://[{address}]:{port}/"
