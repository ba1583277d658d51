"""One run a bench: the instruments at addresses belong to one process at a time, whichever bench file names them.

The locks lie in a folder of the user's own on this machine: two machines, or two users, that share an instrument must
keep out of each other's way themselves.
"""

from __future__ import annotations

import getpass
import hashlib
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from benchctl.atomic import disk_errors
from benchctl.bench import Bench
from benchctl.locks import Lock
from instruments.links.address import parse_address


@contextmanager
def reserved(bench: Bench, purpose: str) -> Iterator[None]:
    """Have the instruments of a real bench to oneself while the block runs; `purpose` is what others are told.

    Raises `UsageError` that names the instrument, and the process that has it.
    """
    folder = lock_folder()
    with disk_errors(folder):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    with ExitStack() as stack:
        for place, (name, address) in _places(bench).items():
            lock = Lock(folder / f"{place}.lock", f"{name} at {address}")
            lock.acquire(purpose)
            stack.callback(lock.release)
        yield


def lock_folder() -> Path:
    """Where the locks of this user's instruments lie."""
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime and Path(runtime).is_dir():
        return Path(runtime) / "benchctl"
    user = re.sub(r"[^A-Za-z0-9._-]+", "_", _user())
    return Path(tempfile.gettempdir()) / f"benchctl-{user}"


def lock_name(address: str) -> str:
    """One name for the ways in which an address can be written.

    >>> lock_name("tcp://LAB-7:702") == lock_name("tcp://lab-7:702")
    True
    >>> lock_name("serial:///dev/ttyS1?baud=9600") == lock_name("serial:///dev/ttyS1?baud=19200")
    True
    """
    where = parse_address(address)
    place = os.path.realpath(where.device) if where.scheme == "serial" else f"{where.host.lower()}:{where.port}"
    readable = re.sub(r"[^A-Za-z0-9]+", "-", place).strip("-")[-40:]
    return f"{readable}-{hashlib.sha256(place.encode()).hexdigest()[:12]}"


def _places(bench: Bench) -> dict[str, tuple[str, str]]:
    """Name of the lock -> instrument and address; two instruments on one bus or gateway share a lock."""
    found: dict[str, tuple[str, str]] = {}
    for name in ("rate_table", "chamber", "digitizer", *(["gyro"] if bench.gyro else [])):
        address = getattr(bench, name).address
        found.setdefault(lock_name(address), (name, address))
    return found


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # no such user is known here, as in many containers
        return "somebody"
