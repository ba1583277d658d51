"""Whether a request was meant for this server, and comes from its own page.

A name that is not ours in `Host` means that somebody's domain was pointed at this machine (DNS rebinding). The port is
not looked at: at the other end of an SSH tunnel it is another one.
"""

from __future__ import annotations

import ipaddress
import socket

from starlette.datastructures import Headers

from benchctl.dashboard.web.refusal import RefusalError

_LOOPBACK_NAMES = frozenset({"127.0.0.1", "::1", "localhost"})


def own_names(host: str) -> frozenset[str]:
    """The names under which a server that listens at `host` may be asked for, beside its addresses."""
    if is_loopback(host):
        return _LOOPBACK_NAMES
    return _LOOPBACK_NAMES | {name.lower() for name in (host, socket.gethostname(), socket.getfqdn())}


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches that address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def refuse_foreign(headers: Headers, names: frozenset[str], *, origin_matters: bool) -> None:
    """Raise `RefusalError` for a `Host` that is not ours, or an `Origin`, where it is sent and matters, that is not."""
    hosts = headers.getlist("host")
    if len(hosts) != 1 or not _is_ours(_name_of(hosts[0]), names):
        raise RefusalError(421, "this server has another name; open it by the address that benchctl serve printed")
    origins = headers.getlist("origin")
    if origin_matters and origins and [origin.lower() for origin in origins] != [f"http://{hosts[0].lower()}"]:
        raise RefusalError(403, "the request comes from another site's page; open the page of this server itself")


def _is_ours(name: str, names: frozenset[str]) -> bool:
    if name in names:
        return True
    if names == _LOOPBACK_NAMES:
        return False
    try:
        ipaddress.ip_address(name)  # an address cannot be pointed at another machine
    except ValueError:
        return False
    return True


def _name_of(host: str) -> str:
    """The name in a `Host` header, lower case, without port and brackets; empty where it is none."""
    name, colon, port = host.rpartition(":")
    if not colon or host.endswith("]"):
        name, port = host, "0"
    if not (port.isascii() and port.isdigit()):
        return ""
    if name.startswith("["):
        return name[1:-1].lower() if name.endswith("]") else ""
    return "" if ":" in name else name.lower()
