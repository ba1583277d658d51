"""Whether a firewall of this machine keeps its own connections from leaving, as far as its rules may be read.

What comes in does not matter here: benchctl only ever connects to instruments.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Iterator
from typing import Any

from benchctl.doctor.asked import answer
from benchctl.doctor.finding import Finding, look, ok

NETWORK = "network"
_STOPS = re.compile(r"^(?:-P OUTPUT (?:DROP|REJECT)|-A OUTPUT .*-j (?:DROP|REJECT).*)$", re.MULTILINE)
_BLOCKS_OUT = re.compile(r"BlockOutbound")
_UFW = re.compile(r"(deny|reject) \(outgoing\)|(?:DENY|REJECT) OUT")


def firewall_findings() -> Iterator[Finding]:
    """What the local firewalls do to connections that leave."""
    if sys.platform == "win32":
        yield windows_finding(answer("netsh", "advfirewall", "show", "allprofiles", "firewallpolicy"))
        return
    told = {
        "nft": answer("nft", "-j", "list", "ruleset"),
        "iptables": answer("iptables", "-S", "OUTPUT"),
        "ufw": answer("ufw", "status", "verbose"),
        "firewalld": answer("firewall-cmd", "--list-all"),
    }
    installed = [name for name in ("nft", "iptables", "ufw", "firewall-cmd") if shutil.which(name)]
    yield firewall_finding(told, installed)


def firewall_finding(told: dict[str, str | None], installed: list[str]) -> Finding:
    """The finding on what the programs print, by their names (None: nothing); `installed` are those that are there."""
    stops = [
        *nft_stops(told.get("nft")),
        *(f"iptables: {rule}" for rule in _STOPS.findall(told.get("iptables") or "")),
        *(f"ufw: {found[0]}" for found in _UFW.finditer(told.get("ufw") or "")),
    ]
    if stops:
        more = f" (and {len(stops) - 1} more)" if len(stops) > 1 else ""
        do = "let connections to the instruments' addresses and ports out, or ask who keeps this machine"
        return look(NETWORK, "firewall here", f"it stops what leaves: {stops[0]}{more}", do)
    read = [name for name, text in told.items() if text]
    if read:
        return ok(NETWORK, "firewall here", f"no rule stops what leaves, as {' and '.join(read)} tell")
    if installed:
        do = "where an instrument is not reached, as root: nft list ruleset; iptables -S"
        return ok(NETWORK, "firewall here", f"{' and '.join(installed)}: their rules may be read by root only", do)
    return ok(NETWORK, "firewall here", "no program that could tell is installed (nft, iptables, ufw, firewalld)")


def nft_stops(text: str | None) -> Iterator[str]:
    """What nftables does to connections that leave, by `nft -j list ruleset`: chains and rules that end them."""
    try:
        items: list[dict[str, Any]] = json.loads(text or "{}").get("nftables", [])
    except (ValueError, AttributeError):
        return
    leaving = set()
    for item in items:
        if (chain := item.get("chain")) and chain.get("hook") == "output":
            leaving.add((chain.get("family"), chain.get("table"), chain.get("name")))
            if chain.get("policy") == "drop":
                yield f"nft: chain {chain.get('table')} {chain.get('name')} has the policy drop"
    for item in items:
        rule = item.get("rule") or {}
        where = (rule.get("family"), rule.get("table"), rule.get("chain"))
        ends = [word for part in rule.get("expr", []) for word in ("drop", "reject") if word in part]
        if where in leaving and ends:
            yield f"nft: rule {rule.get('handle', '')} of chain {where[1]} {where[2]}: {ends[0]}"


def windows_finding(told: str | None) -> Finding:
    """By `netsh advfirewall`; not tried on Windows."""
    if told is None or not told.strip():
        return ok(NETWORK, "firewall here", "netsh does not tell (not tried on Windows)")
    if _BLOCKS_OUT.search(told):
        do = "as administrator, let python.exe out: Windows Defender Firewall > Advanced settings > Outbound Rules"
        return look(NETWORK, "firewall here", "a profile blocks what leaves (BlockOutbound; not tried on Windows)", do)
    return ok(NETWORK, "firewall here", "no profile blocks what leaves, as netsh tells (not tried on Windows)")
