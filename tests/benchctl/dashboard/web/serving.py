"""`benchctl serve` as a process of its own, and clients that ask it over real sockets."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
from websockets.sync.client import ClientConnection, connect


@dataclass(frozen=True)
class Served:
    """A server that answers."""

    process: subprocess.Popen[str]
    url: str
    token: str
    view_token: str
    release_token: str

    @property
    def port(self) -> int:
        return int(self.url.rstrip("/").rpartition(":")[2])

    def client(self, token: str | None = "", *, timeout_s: float = 30.0, **headers: str) -> httpx.Client:
        """Somebody who shows a token: the one that may stop a run, another, or None."""
        shown = {} if token is None else {"Authorization": f"Bearer {token or self.token}"}
        # there is no TLS here, and to read all certificates of the system takes longer than a request
        return httpx.Client(base_url=self.url, headers={**shown, **headers}, timeout=timeout_s, verify=False)

    @contextmanager
    def browser(self, token: str = "") -> Iterator[tuple[httpx.Client, str]]:
        """Somebody who has logged in and shows only the cookie; and the session's CSRF word."""
        with self.client(None) as client:
            said = client.post("/api/session", headers={"Authorization": f"Bearer {token or self.token}"})
            assert said.status_code == 200, said.text
            yield client, said.json()["csrf"]

    def watch(self, key: str, token: str | None = "", **options: Any) -> ClientConnection:
        """A websocket that follows a campaign."""
        shown = {} if token is None else {"Authorization": f"Bearer {token or self.token}"}
        shown |= options.pop("headers", {})
        url = f"ws://127.0.0.1:{self.port}/api/campaigns/{key}/live"
        connection: ClientConnection = connect(url, additional_headers=shown, proxy=None, **options)
        return connection

    def line(self, timeout_s: float = 10.0) -> socket.socket:
        """A bare connection."""
        return socket.create_connection(("127.0.0.1", self.port), timeout=timeout_s)

    def key_of(self, name: str) -> str:
        """The id of the campaign of that name, once the list has it."""
        ends_s = time.monotonic() + 10.0
        while time.monotonic() < ends_s:
            with self.client() as client:
                listed = client.get("/api/campaigns").json()["campaigns"]
            if found := [campaign["id"] for campaign in listed if campaign["name"] == name]:
                return str(found[0])
            time.sleep(0.2)
        raise AssertionError(f"{name} is not in the list: {listed}")

    def stop(self, timeout_s: float = 20.0) -> str:
        """End it as the system would; returns what it said on stderr."""
        self.process.send_signal(signal.SIGTERM)
        return self.process.communicate(timeout=timeout_s)[1]


def everything(line: socket.socket) -> bytes:
    """All that is answered until the server closes."""
    parts = []
    while part := line.recv(65536):
        parts.append(part)
    return b"".join(parts)


@contextmanager
def serving(folder: Path, cache: Path, *arguments: str | Path) -> Iterator[Served]:
    """Serve the campaigns below a folder until the block ends."""
    with subprocess.Popen(
        [sys.executable, "-m", "benchctl", "serve", str(folder), *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "BENCHCTL_CACHE": str(cache)},
    ) as process:
        try:
            assert process.stdout is not None
            yield Served(process, **json.loads(process.stdout.readline()))
        finally:
            process.kill()
