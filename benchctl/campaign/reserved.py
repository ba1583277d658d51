"""Reserve instruments: one belongs to one process of this machine at a time, whichever bench file names it.

An instrument is identified by its location, not by the spelling of its address: a serial port by its real path and its
device number, a network address by port and IP addresses. All names of this machine count as one. The locks are in a
folder that depends on neither environment nor user. They do not reach other machines; `refuse_bench_in_use` detects
signs of a run there.
"""

from __future__ import annotations

import hashlib
import ipaddress
import os
import re
import socket
import stat
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from benchctl.bench import Bench
from benchctl.locks import held
from benchctl_instruments.errors import UsageError, reason
from benchctl_instruments.links.address import parse_address

# S108: a lock is shared by all users, so its folder is a public one
LOCK_PLACES = tuple(map(Path, ("C:/ProgramData",) if os.name == "nt" else ("/run/lock", "/var/lock", "/tmp")))  # noqa: S108
"""Possible parents of the lock folder: the first in which every user may create one is used. Not tested on Windows."""


class BenchInUseError(UsageError):
    """Another process has an instrument of the bench; nothing was sent to any."""

    exit_status = 3


@contextmanager
def reserved(bench: Bench, purpose: str) -> Iterator[frozenset[str]]:
    """Reserve the instruments of a real bench while the block runs; `purpose` is shown to other processes.

    Yields the names of the instruments whose last holder ended without releasing them, as a killed run does. Raises
    `BenchInUseError` with the instrument and the process that has it.
    """
    abandoned = set()
    make_lock_folder()
    with ExitStack() as stack:
        taken: set[Path] = set()  # two instruments on one bus or gateway share a lock
        for name, entry in bench.entries.items():
            addresses = filter(None, (entry.address, getattr(entry, "stream_address", None)))
            paths = sorted({path for address in addresses for path in lock_files(address)} - taken)
            taken.update(paths)
            try:
                was_abandoned = stack.enter_context(held(paths, f"{name} at {entry.address}", purpose))
            except UsageError as err:
                raise BenchInUseError(str(err)) from err
            if was_abandoned:
                abandoned.add(name)
        yield frozenset(abandoned)


def lock_folder() -> Path:
    """Return the folder of the locks of this machine's instruments."""
    return next((place for place in LOCK_PLACES if _is_for_all(place)), LOCK_PLACES[-1]) / "benchctl"


def make_lock_folder() -> Path:
    """Return the folder of the locks, created if it does not exist; raises `UsageError` if that is impossible."""
    folder = lock_folder()
    try:
        folder.mkdir(exist_ok=True)
        if folder.is_symlink():
            raise UsageError(f"{folder}: expected a folder for the locks of instruments, this is a link; remove it")
        with suppress(PermissionError):  # another user made it
            # not sticky: another user's next run must be able to remove what a killed run left
            folder.chmod(0o777)
    except OSError as err:
        raise UsageError(f"{folder}: the locks of instruments cannot lie there: {reason(err)}; remove it") from err
    return folder


def lock_files(address: str) -> tuple[Path, ...]:
    """Return the lock files of an instrument, sorted: one for each location that its address refers to.

    >>> lock_files("tcp://LOCALHOST:702") == lock_files("socket://127.0.0.1:0702")
    True
    >>> lock_files("serial:///dev/ttyS1?baud=9600") == lock_files("serial:///dev/ttyS1?baud=19200")
    True
    >>> lock_files("visa://GPIB0::7::INSTR") == lock_files("visa://gpib0::7::instr")
    True
    >>> lock_files("daqmx://127.0.0.1:31763/Dev1") == lock_files("daqmx://127.0.0.1:31763/Dev2")
    False
    """
    where = parse_address(address)
    if where.scheme == "serial":
        places = _port(where.device)
    elif where.scheme == "visa":
        places = {f"visa:{where.device.upper()}"}
    elif where.scheme == "daqmx":
        hosts = {f"{host}:{where.port}/" for host in _hosts(where.host)} if where.host else {""}
        places = {f"daqmx:{host}{where.device.upper()}" for host in hosts}
    else:
        places = {f"{host}:{where.port}" for host in _hosts(where.host)}
    return tuple(sorted(map(lock_file, places)))


def lock_file(place: str) -> Path:
    """Return the lock file of a place: an address, or the real path of a file."""
    return lock_folder() / f"{_file_name(place)}.lock"


def _port(device: str) -> set[str]:
    """Return the real path of a port and its number, because a container or a copied node may use another path."""
    path = os.path.realpath(device)
    places = {os.path.normcase(path)}
    with suppress(OSError):
        found = Path(path).stat()
        if stat.S_ISCHR(found.st_mode) and os.name != "nt":
            places.add(f"device:{found.st_rdev}")
    return places


def _file_name(place: str) -> str:
    readable = re.sub(r"[^A-Za-z0-9]+", "-", place).strip("-")[-40:]
    return f"{readable}-{hashlib.sha256(place.encode()).hexdigest()[:12]}"


def _hosts(host: str) -> set[str]:
    """Return the IP addresses of a host, "localhost" for each one of this machine; the name itself if it has none."""
    try:
        found = {str(info[4][0]) for info in socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)}
    except (OSError, UnicodeError):
        return {host.lower()}
    return {_host(text) for text in found}


def _host(text: str) -> str:
    ip = ipaddress.ip_address(text)
    ip = getattr(ip, "ipv4_mapped", None) or ip
    if ip.is_loopback:
        return "localhost"
    family = socket.AF_INET6 if ip.version == 6 else socket.AF_INET
    with suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as own:
        own.bind((str(ip), 0))  # only an address of this machine can be bound
        return "localhost"
    return str(ip)


def _is_for_all(place: Path) -> bool:
    """Whether every user may create files there; the result is the same for all users."""
    with suppress(OSError):
        mode = place.stat().st_mode
        return stat.S_ISDIR(mode) and (os.name == "nt" or mode & 0o1777 == 0o1777)
    return False
