"""Where a simulated instrument listens: the address in words, and a socket that does not block."""

from __future__ import annotations

import socket

from benchctl_instruments.errors import UsageError, reason

Where = tuple[str, int]
"""Host and port; port 0 takes a free one."""


def address_of(where: Where) -> str:
    """`tcp://HOST:PORT`, an IPv6 host in brackets."""
    host, port = where
    return f"tcp://{f'[{host}]' if ':' in host else host}:{port}"


def listen(where: Where) -> tuple[socket.socket, Where]:
    """A listening socket, and where it really listens; `UsageError` where the port is taken or may not be used."""
    host = where[0]
    try:
        listener = socket.create_server(where, family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    except OSError as err:
        raise UsageError(f"cannot listen at {address_of(where)}: {reason(err)}; choose another port, or 0") from err
    listener.setblocking(False)
    return listener, (host, listener.getsockname()[1])
