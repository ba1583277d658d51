"""Servers that receive the messages of `[notify]`: an HTTP server for json:// URLs, and a mail server."""

from __future__ import annotations

import json
import socketserver
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

Received = list[tuple[str, str]]
"""Title and text of each message."""


@contextmanager
def receiving(status: int = 200, wait: threading.Event | None = None) -> Iterator[tuple[int, Received]]:
    """Serve on a free port, with this HTTP status; with `wait`, an answer comes once it is set."""
    received: Received = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            post = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            received.append((post["title"], post["message"]))
            if wait is not None:
                wait.wait()
            self.send_response(status)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        yield from _served(server, received)


@contextmanager
def receiving_mail() -> Iterator[tuple[int, Received]]:
    """Serve mail on a free port, by the part of SMTP (RFC 5321) that a client without encryption needs."""
    received: Received = []
    answers = {b"EHLO": b"250-mail\r\n250 AUTH PLAIN\r\n", b"AUTH": b"235 ok\r\n", b"QUIT": b"221 bye\r\n"}

    class Handler(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            self.wfile.write(b"220 mail\r\n")
            while line := self.rfile.readline().strip().upper():
                if line == b"DATA":
                    self.wfile.write(b"354 go on\r\n")
                    lines = iter(self.rfile.readline, b".\r\n")
                    received.append(("", b"".join(lines).decode("utf-8")))
                self.wfile.write(answers.get(line.split()[0], b"250 ok\r\n"))

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler) as server:
        yield from _served(server, received)


def _served(server: socketserver.TCPServer, received: Received) -> Iterator[tuple[int, Received]]:
    thread = threading.Thread(target=lambda: server.serve_forever(poll_interval=0.01))
    thread.start()
    try:
        yield server.server_address[1], received
    finally:
        server.shutdown()
        thread.join()
