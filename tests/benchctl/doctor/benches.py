"""Benches with addresses, as the doctor meets them, and servers that are no instruments."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from benchctl.bench import Bench, load_bench

NOBODY = {"rate_table": "tcp://127.0.0.1:1", "chamber": "tcp://127.0.0.1:2", "digitizer": "tcp://127.0.0.1:3"}
"""Privileged ports at which nobody listens."""


def bench_at(addresses: dict[str, str], **changes: dict[str, Any]) -> Bench:
    """The simulated bench as a real one at these addresses; `changes` are further fields of an instrument."""
    bench = load_bench("simulated")
    stream = {"stream_address": addresses["digitizer_stream"]} if "digitizer_stream" in addresses else {}
    entries = {
        role: getattr(bench, role).model_copy(
            update={
                "address": addresses.get(role, NOBODY[role]),
                **(stream if role == "digitizer" else {}),
                **changes.get(role, {}),
            }
        )
        for role in NOBODY
    }
    return bench.model_copy(update={"simulated": False, **entries})


@contextmanager
def server(answer: bytes) -> Iterator[str]:
    """A TCP server that takes every connection and answers whatever comes with these bytes; with none, never."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        over = threading.Event()

        def talk(connection: socket.socket) -> None:
            with connection:
                connection.settimeout(20.0)
                try:
                    while connection.recv(4096) and not over.is_set():
                        if answer:
                            connection.sendall(answer)
                except OSError:
                    return

        def serve() -> None:
            while not over.is_set():
                connection, _ = listener.accept()
                threading.Thread(target=talk, args=(connection,), daemon=True).start()

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        host, port = listener.getsockname()
        yield f"tcp://{host}:{port}"
        over.set()
        with socket.create_connection((host, port), timeout=5):
            thread.join(5)
