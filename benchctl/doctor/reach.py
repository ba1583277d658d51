"""Connect to the host and port of an instrument; if that fails, find out on which side the cause is."""

from __future__ import annotations

import errno
import socket
import sys
import threading
from dataclasses import dataclass
from ipaddress import IPv4Network, ip_address
from typing import Literal

import psutil

from benchctl.doctor.finding import Finding, bad, ok
from benchctl_instruments.links.address import Address

CONNECT_S = 5.0
"""Longer than the 3 s after which Linux reports a neighbour that does not answer ARP."""
_RESOLVE_S = 5.0
_BANNER_S = 0.3

Outcome = Literal["connected", "unresolved", "refused", "no answer", "no route", "unreachable", "forbidden", "failed"]

_OUTCOMES: dict[int, Outcome] = {
    errno.ECONNREFUSED: "refused",
    errno.ETIMEDOUT: "no answer",
    errno.ENETUNREACH: "no route",
    errno.EHOSTUNREACH: "unreachable",
    errno.EHOSTDOWN: "unreachable",
    errno.EPERM: "forbidden",
    errno.EACCES: "forbidden",
}

_USUAL_PORTS: dict[str, tuple[int, ...]] = {
    "acutrol3000": (9888, 9878),
    "aerotech_ensemble": (8000,),
    "newport_esp301": (5001,),
    "labjack_t7": (502, 702),
    "keithley_daq6510": (5025,),
    "keysight_34970a": (5025,),
    "keysight_daq970a": (5025,),
    "watlow_f4t": (502,),
    "watlow_f4t_scpi": (5025,),
    "espec_p300": (10001,),
    "binder_mb1": (10001,),
    "binder_mb2": (10001,),
    "thermotron_8800": (8888,),
    "weiss_simserv": (2049,),
    "weiss_ascii2": (2049,),
}
"""Factory settings of TCP ports, from makers' documents or published drivers; see the docstrings of our drivers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reached:
    """The result: `host` is the numeric address that was tried, `detail` the system's error message.

    `banner` holds the bytes that the other side sent without a request.
    """

    outcome: Outcome
    host: str = ""
    detail: str = ""
    banner: bytes = b""


def reach(host: str, port: int, connect_s: float = CONNECT_S) -> Reached:
    """Resolve, connect, listen for a moment, and close; nothing is sent."""
    numeric, reason = _resolved(host, port)
    if not numeric:
        return Reached(outcome="unresolved", detail=reason)
    try:
        with socket.create_connection((numeric, port), timeout=connect_s) as connection:
            connection.settimeout(_BANNER_S)
            try:
                banner = connection.recv(200)
            except OSError:  # the other side waits for a request, as is usual
                banner = b""
            return Reached(outcome="connected", host=numeric, banner=banner)
    except TimeoutError:
        return Reached(outcome="no answer", host=numeric, detail=f"no answer within {connect_s:g} s")
    except OSError as err:
        return Reached(outcome=_OUTCOMES.get(err.errno or 0, "failed"), host=numeric, detail=err.strerror or str(err))


def reach_finding(role: str, address: Address, model: str, reached: Reached, what: str = "connection") -> Finding:
    """Return a finding that explains an outcome and what to do; `ok` if the connection was accepted."""
    where, numeric = f"{address.host}, port {address.port}", reached.host
    subnet = subnet_of(numeric) if numeric else ""
    route = f"in the subnet {subnet} of this machine" if subnet else "in no subnet of this machine"
    if subnet.startswith("127."):
        route = "this machine itself"
    match reached.outcome:
        case "connected":
            return ok(role, what, f"{where} accepts a connection ({route})")
        case "unresolved":
            message = f"no host is named {address.host!r}: {reached.detail}"
            do = (
                "write its number into the address (192.168.1.60, as its panel shows it), or enter the name in the "
                "hosts file or the network's name server"
            )
        case "refused":
            message = f"{where}: the machine is there and refuses that port ({route})"
            do = f"start what serves port {address.port} there (benchctl sim, its network interface, its gateway), or "
            do += f"correct the port{usual_ports(model)}"
        case "forbidden":
            message = f"{where}: a firewall or route of this machine does not let it out ({reached.detail})"
            do = "check the firewall and the routes of this machine: nft list ruleset; ip route"
        case "no route":
            message = f"{where}: this machine has no route to it ({route})"
            do = "give a network interface of this machine an address in the instrument's subnet: ip addr; ip route"
        case "no answer" if subnet and route != "this machine itself" and sys.platform == "linux":
            message = f"{where}: its network card answers, its port does not ({route})"
            do = "a firewall on its side drops it: open the port there; or the instrument hangs: switch it off and on"
        case "unreachable" if subnet:
            message = f"{where}: no device in the subnet has that address: {reached.detail} ({route})"
            do = "switch it on, plug in its cable (is its link LED on?), and compare the address with that on its panel"
        case "no answer" | "unreachable" if not subnet:
            message = f"{where}: {reached.detail} ({route}, reached through a gateway)"
            do = (
                f"ping {numeric}; if the instrument is in this room, give this machine an address in its subnet; "
                "otherwise the gateway or a firewall behind it drops it: ask who administers the network"
            )
        case _:
            message = f"{where}: {reached.detail} ({route})"
            do = f"ping {numeric}; check power and cable, then the firewalls on both sides"
    return bad(role, what, message, do)


def usual_ports(model: str) -> str:
    """Return a hint at the usual ports of a model; empty if none is known."""
    ports = _USUAL_PORTS.get(model, ())
    return f"; {model} usually answers at port {' or '.join(map(str, ports))}" if ports else ""


def subnet_of(host: str) -> str:
    """Return the smallest IPv4 subnet of this machine that contains a numeric address; empty if none does."""
    try:
        address = ip_address(host)
    except ValueError:
        return ""
    if address.is_loopback:
        return "127.0.0.0/8"
    subnets = (
        IPv4Network((each.address, each.netmask), strict=False)
        for addresses in psutil.net_if_addrs().values()
        for each in addresses
        if each.family is socket.AF_INET and each.netmask
    )
    return str(max((net for net in subnets if address in net), key=lambda net: net.prefixlen, default=""))


def _resolved(host: str, port: int) -> tuple[str, str]:
    """Return the numeric address, or an empty text and the reason; wait for a name server for a limited time."""
    found: list[tuple[str, str]] = []

    def resolve() -> None:
        try:
            found.append((str(socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][4][0]), ""))
        except (OSError, UnicodeError) as err:
            found.append(("", getattr(err, "strerror", None) or str(err)))

    thread = threading.Thread(target=resolve, name=f"resolve {host}", daemon=True)
    thread.start()
    thread.join(_RESOLVE_S)
    return found[0] if found else ("", f"no name server answered within {_RESOLVE_S:g} s")
