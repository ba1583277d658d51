"""Whether anybody takes a connection at a host and port; and if not, on which side that is."""

from __future__ import annotations

import errno
import socket
import threading
from dataclasses import dataclass
from typing import Literal

from benchctl.doctor.finding import Finding, bad, ok
from benchctl.doctor.network.ports_of_models import usual_ports
from benchctl.doctor.network.routes import is_there, route_to
from benchctl_instruments.links.address import Address

CONNECT_S = 3.0
_RESOLVE_S = 5.0
_BANNER_S = 0.3

Outcome = Literal["connected", "unresolved", "refused", "no answer", "unreachable", "forbidden", "failed"]

_OUTCOMES: dict[int, Outcome] = {
    errno.ECONNREFUSED: "refused",
    errno.ETIMEDOUT: "no answer",
    errno.ENETUNREACH: "unreachable",
    errno.EHOSTUNREACH: "unreachable",
    errno.EHOSTDOWN: "unreachable",
    errno.EPERM: "forbidden",
    errno.EACCES: "forbidden",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reached:
    """How it went: `host` is the numeric address that was tried, `detail` the system's own words.

    `banner` is what came over a connection before anything was asked.
    """

    outcome: Outcome
    host: str = ""
    detail: str = ""
    banner: bytes = b""


def reach(host: str, port: int, connect_s: float = CONNECT_S) -> Reached:
    """Resolve, connect, listen for a moment, and hang up; nothing is sent."""
    found = _resolved(host, port)
    if isinstance(found, str):
        return Reached(outcome="unresolved", detail=found)
    numeric = str(found[0])
    try:
        with socket.create_connection((numeric, port), timeout=connect_s) as connection:
            connection.settimeout(_BANNER_S)
            try:
                banner = connection.recv(200)
            except OSError:  # nobody speaks first, as is usual
                banner = b""
            return Reached(outcome="connected", host=numeric, banner=banner)
    except TimeoutError:
        return Reached(outcome="no answer", host=numeric, detail=f"no answer within {connect_s:g} s")
    except OSError as err:
        return Reached(outcome=_OUTCOMES.get(err.errno or 0, "failed"), host=numeric, detail=err.strerror or str(err))


def reach_finding(role: str, address: Address, model: str, reached: Reached, what: str = "connection") -> Finding:
    """What an outcome means, and what to do; `ok` where the connection was taken."""
    where, numeric = f"{address.host}, port {address.port}", reached.host
    route = route_to(numeric)
    usual = usual_ports(model)
    hint = f"; {usual}" if usual else ""
    match reached.outcome:
        case "connected":
            return ok(role, what, f"{where} takes a connection ({route})")
        case "unresolved":
            return bad(
                role,
                what,
                f"nobody knows a host {address.host!r}: {reached.detail}",
                "write its number into the address (192.168.1.60, as its panel shows it), or enter the name in the "
                "hosts file or the network's name server",
            )
        case "refused":
            do = (
                f"start what serves port {address.port} there (benchctl sim, its network interface, its gateway), or "
                f"correct the port{hint}"
            )
            return bad(role, what, f"{where}: the machine is there and refuses that port ({route})", do)
        case "forbidden":
            do = "look at the firewall and the routes of this machine: nft list ruleset; ip route"
            return bad(role, what, f"{where}: this machine itself does not let it out ({reached.detail})", do)
        case "no answer" | "unreachable":
            return _nobody(role, where, numeric, reached, what)
        case _:
            return bad(role, what, f"{where}: {reached.detail} ({route})", "check power, cable and address")


def _nobody(role: str, where: str, numeric: str, reached: Reached, what: str) -> Finding:
    """No answer: by whom it is kept back, as far as routes and the neighbours' network cards tell."""
    route, there = route_to(numeric), is_there(numeric)
    if route.way == "none" or "etwork is unreachable" in reached.detail:
        do = "give a network interface of this machine an address in the instrument's subnet: ip addr; ip route"
        return bad(role, what, f"{where}: there is no way to it ({route})", do)
    if route.way == "neighbour" and there:
        return bad(
            role,
            what,
            f"{where}: its network card answers, and the port does not, not even with a refusal ({route})",
            "a firewall on its side drops it: let the port in there; or the instrument hangs: switch it off and on",
        )
    if route.way == "neighbour" and (there is False or reached.outcome == "unreachable"):
        return bad(
            role,
            what,
            f"{where}: nobody in the subnet has that address: {reached.detail} ({route})",
            "switch it on, plug in its cable (do its lamps light?), and compare the address with that on its panel",
        )
    if route.way == "gateway":
        return bad(
            role,
            what,
            f"{where}: {reached.detail} ({route})",
            f"ping {numeric}; if the instrument is in this room, give this machine an address in its subnet; otherwise "
            "the gateway or a firewall behind it drops it: ask who keeps the network",
        )
    do = f"ping {numeric}; check power and cable, then the firewalls on both sides"
    return bad(role, what, f"{where}: {reached.detail} ({route})", do)


def _resolved(host: str, port: int) -> tuple[str, int] | str:
    """Numeric address and port, or why there is none; a name server that is silent is not waited for beyond a while."""
    told: list[tuple[str, int] | str] = []

    def resolve() -> None:
        try:
            numeric = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][4]
            told.append((str(numeric[0]), port))
        except (OSError, UnicodeError) as err:
            told.append(getattr(err, "strerror", None) or str(err))

    thread = threading.Thread(target=resolve, name=f"resolve {host}", daemon=True)
    thread.start()
    thread.join(_RESOLVE_S)
    return told[0] if told else f"no name server answered within {_RESOLVE_S:g} s"
