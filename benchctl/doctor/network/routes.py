"""How an address is reached, by Linux' own tables: whether it is a neighbour, and whether that neighbour is there.

IPv4 only; of other addresses, and on other systems, nothing is known and nothing is said.
"""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network, ip_address
from pathlib import Path
from typing import Literal

NET = Path("/proc/net")
_UP, _COMPLETE = 0x1, 0x2
_NOT_SET = 0

Way = Literal["loopback", "neighbour", "gateway", "none", "unknown"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Route:
    """The way to an address: by which interface, through which gateway, from which subnet of this machine."""

    way: Way
    interface: str = ""
    subnet: str = ""
    gateway: str = ""

    def __str__(self) -> str:
        match self.way:
            case "loopback":
                return "this machine itself"
            case "neighbour":
                return f"in our subnet {self.subnet} at {self.interface}"
            case "gateway":
                return f"in no subnet of ours: by {self.interface} through the gateway {self.gateway}"
            case "none":
                return "in no subnet of ours, and no gateway is set"
            case _:
                return "no route is known here"


def route_to(host: str, net: Path = NET) -> Route:
    """The route of the longest prefix to a numeric address."""
    address = _v4(host)
    if address is None:
        return Route(way="unknown")
    if address.is_loopback:
        return Route(way="loopback")
    try:
        lines = (net / "route").read_text(encoding="ascii", errors="replace").splitlines()[1:]
    except OSError:
        return Route(way="unknown")
    best: tuple[int, Route] = (-1, Route(way="none"))
    for line in lines:
        fields = line.split()
        if len(fields) < 8 or not int(fields[3], 16) & _UP:
            continue
        target, gateway, mask = (IPv4Address(int(fields[at], 16).to_bytes(4, "little")) for at in (1, 2, 7))
        subnet = IPv4Network((int(target), str(mask)))
        if address in subnet and subnet.prefixlen > best[0]:
            if int(gateway) == _NOT_SET:
                found = Route(way="neighbour", interface=fields[0], subnet=str(subnet))
            else:
                found = Route(way="gateway", interface=fields[0], gateway=str(gateway))
            best = (subnet.prefixlen, found)
    return best[1]


def is_there(host: str, net: Path = NET) -> bool | None:
    """Whether a neighbour's network card has answered of late (ARP), after it was asked; None: nothing is known."""
    try:
        lines = (net / "arp").read_text(encoding="ascii", errors="replace").splitlines()[1:]
    except OSError:
        return None
    for line in lines:
        fields = line.split()
        if len(fields) >= 3 and fields[0] == host:
            return bool(int(fields[2], 16) & _COMPLETE)
    return None


def _v4(host: str) -> IPv4Address | None:
    try:
        address = ip_address(host)
    except ValueError:
        return None
    return address if isinstance(address, IPv4Address) else None
