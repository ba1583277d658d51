"""What the simulated bench and parallel work need of a system: loopback sockets, pseudo-terminals, shared locks."""

from __future__ import annotations

import multiprocessing
import os
import socket
import sys
from collections.abc import Iterator

from benchctl.doctor.finding import MACHINE, Finding, bad, look, ok

_PATIENCE_S = 3.0
_WORD = b"benchctl"


def simulation_findings() -> Iterator[Finding]:
    """Each of them tried."""
    yield _loopback()
    yield _terminal()
    yield _shared_lock()


def _loopback() -> Finding:
    try:
        with socket.create_server(("127.0.0.1", 0)) as server:
            server.settimeout(_PATIENCE_S)
            with socket.create_connection(server.getsockname(), timeout=_PATIENCE_S) as near:
                far, _ = server.accept()
                with far:
                    far.settimeout(_PATIENCE_S)
                    near.sendall(_WORD)
                    heard = far.recv(64)
    except OSError as err:
        return bad(
            MACHINE,
            "loopback",
            f"127.0.0.1 cannot be talked to: {err.strerror or err}; the simulated bench needs it",
            "bring it up (sudo ip link set lo up), or let the sandbox in which this runs open sockets",
            unusable=True,
        )
    if heard != _WORD:
        do = "look for a program that filters connections of this machine to itself"
        return bad(MACHINE, "loopback", f"sent {_WORD!r} to 127.0.0.1, {heard!r} came", do, unusable=True)
    return ok(MACHINE, "loopback", "127.0.0.1 answers: simulated instruments can be reached")


def _terminal() -> Finding:
    if sys.platform == "win32":
        return ok(MACHINE, "pseudo-terminals", "Windows has none; simulated serial instruments are served over TCP")
    try:
        master, slave = os.openpty()
    except OSError as err:
        return look(
            MACHINE,
            "pseudo-terminals",
            f"none can be made: {err.strerror or err}; instruments with a serial line cannot be simulated on one",
            "mount devpts at /dev/pts, or give such instruments a tcp:// address",
        )
    try:
        name = os.ttyname(slave)
    finally:
        os.close(master)
        os.close(slave)
    return ok(MACHINE, "pseudo-terminals", f"made {name}: instruments with a serial line can be simulated")


def _shared_lock() -> Finding:
    try:
        multiprocessing.Lock()
    except (OSError, ImportError) as err:
        return look(
            MACHINE,
            "shared locks",
            f"processes cannot share a lock: {getattr(err, 'strerror', None) or err}; work on several cores needs it",
            "mount a tmpfs at /dev/shm that this user may write to (in a container: --shm-size 256m)",
        )
    return ok(MACHINE, "shared locks", "processes can share a lock: work can go on on several cores")
