"""One run on a bench: an instrument belongs to one process of this machine at a time, whichever bench file names it.

An instrument is known by where it is, not by how its address is spelt: a serial port by its real path and its device
number, a network address by port and IP addresses. All names of this machine are one. The locks lie in a folder that
depends on neither environment nor user. They do not reach other machines; `refuse_bench_in_use` finds what shows of a
run there.
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

LOCK_PLACES = tuple(map(Path, ("C:/ProgramData",) if os.name == "nt" else ("/run/lock", "/var/lock", "/tmp")))  # noqa: S108
"""Where the folder of the locks is made: the first one in which every user may make one. Not tried on Windows."""


class BenchInUseError(UsageError):
    """Another process has an instrument of the bench; nothing was sent to any."""

    exit_status = 3


@contextmanager
def reserved(bench: Bench, purpose: str) -> Iterator[frozenset[str]]:
    """Have the instruments of a real bench to oneself while the block runs; `purpose` is shown to others.

    Yields the names of those whose last holder ended without releasing them, as a killed run does. Raises
    `BenchInUseError` that names the instrument, and the process that has it.
    """
    abandoned = set()
    make_lock_folder()
    with ExitStack() as stack:
        seen: set[Path] = set()  # two instruments on one bus or gateway share a lock
        for name, entry in bench.entries.items():
            addresses = filter(None, (entry.address, getattr(entry, "stream_address", None)))
            paths = sorted({path for address in addresses for path in lock_files(address)} - seen)
            seen.update(paths)
            try:
                was_abandoned = stack.enter_context(held(paths, f"{name} at {entry.address}", purpose))
            except UsageError as err:
                raise BenchInUseError(str(err)) from err
            if was_abandoned:
                abandoned.add(name)
        yield frozenset(abandoned)


def lock_folder() -> Path:
    """Where the locks of this machine's instruments lie."""
    return next((place for place in LOCK_PLACES if _is_for_all(place)), LOCK_PLACES[-1]) / "benchctl"


def make_lock_folder() -> Path:
    """The folder of the locks, made where it is not there; `UsageError` where that is impossible."""
    folder = lock_folder()
    try:
        folder.mkdir(exist_ok=True)
        if folder.is_symlink():
            raise UsageError(f"{folder}: expected a folder for the locks of instruments, this is a link; remove it")
        with suppress(PermissionError):  # another user made it
            # not sticky: what a killed run of one user left, the next run of another one must be able to remove
            folder.chmod(0o777)
    except OSError as err:
        raise UsageError(f"{folder}: the locks of instruments cannot lie there: {reason(err)}; remove it") from err
    return folder


def lock_files(address: str) -> tuple[Path, ...]:
    """The files of an instrument's locks, sorted: one for each place that its address stands for.

    >>> lock_files("tcp://LOCALHOST:702") == lock_files("socket://127.0.0.1:0702")
    True
    >>> lock_files("serial:///dev/ttyS1?baud=9600") == lock_files("serial:///dev/ttyS1?baud=19200")
    True
    """
    where = parse_address(address)
    if where.scheme == "serial":
        places = _port(where.device)
    else:
        places = {f"{host}:{where.port}" for host in _hosts(where.host)}
    return tuple(sorted(lock_folder() / f"{_file_name(place)}.lock" for place in places))


def _port(device: str) -> set[str]:
    """The real path of a port and, for a container or a copy of the node may name it otherwise, its number."""
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
    """The IP addresses of a host, "localhost" for each that is this machine's; the name itself where it has none."""
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
    """Whether every user may make files there; the same for each of them, whatever else they may."""
    with suppress(OSError):
        mode = place.stat().st_mode
        return stat.S_ISDIR(mode) and (os.name == "nt" or mode & 0o1777 == 0o1777)
    return False
