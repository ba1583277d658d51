"""By the words that the programs print, as their manuals show them."""

import json

import pytest

from benchctl.doctor.network.firewalls import firewall_finding, firewall_findings, windows_finding


def _nft(policy: str, hook: str = "output", ends: str = "accept") -> str:
    rule = {"family": "inet", "table": "filter", "chain": "out", "handle": 7, "expr": [{"counter": {}}, {ends: None}]}
    chain = {"family": "inet", "table": "filter", "name": "out", "hook": hook, "policy": policy}
    return json.dumps({"nftables": [{"metainfo": {}}, {"chain": chain}, {"rule": rule}]})


@pytest.mark.parametrize(
    ("program", "text", "says"),
    [
        ("nft", _nft("drop"), "chain filter out has the policy drop"),
        ("nft", _nft("accept", ends="reject"), "rule 7 of chain filter out: reject"),
        (
            "iptables",
            "-P OUTPUT ACCEPT\n-A OUTPUT -p tcp --dport 502 -j DROP\n",
            "-A OUTPUT -p tcp --dport 502 -j DROP",
        ),
        ("iptables", "-P OUTPUT DROP\n", "iptables: -P OUTPUT DROP"),
        ("ufw", "Status: active\nDefault: deny (incoming), deny (outgoing)\n", "ufw: deny (outgoing)"),
        ("ufw", "Status: active\n502/tcp   DENY OUT   Anywhere\n", "ufw: DENY OUT"),
    ],
)
def test_what_stops_connections_that_leave_is_told(program: str, text: str, says: str) -> None:
    finding = firewall_finding({program: text}, [program])
    assert finding.verdict == "look"
    assert says in finding.says


@pytest.mark.parametrize(
    ("program", "text"),
    [
        ("nft", _nft("drop", hook="input")),
        ("nft", _nft("accept")),
        ("iptables", "-P OUTPUT ACCEPT\n"),
        ("ufw", "Status: active\nDefault: deny (incoming), allow (outgoing)\n"),
        ("firewalld", "public (active)\n  services: ssh\n"),
    ],
)
def test_what_stops_only_connections_that_come_in_does_not_matter(program: str, text: str) -> None:
    finding = firewall_finding({program: text}, [program])
    assert (finding.verdict, finding.says) == ("ok", f"no rule stops what leaves, as {program} tell")


def test_rules_that_may_not_be_read_are_no_proof() -> None:
    finding = firewall_finding({"nft": None, "iptables": ""}, ["nft", "iptables"])
    assert "their rules may be read by root only" in finding.says
    assert "nft list ruleset" in finding.do
    assert "no program that could tell" in firewall_finding({}, []).says
    assert firewall_finding({"nft": "not json"}, ["nft"]).verdict == "ok"


def test_a_profile_of_windows_that_blocks_what_leaves_is_told() -> None:
    assert windows_finding("Firewall Policy    BlockInbound,BlockOutbound").verdict == "look"
    assert windows_finding("Firewall Policy    BlockInbound,AllowOutbound").verdict == "ok"
    assert "not tried" in windows_finding(None).says


def test_the_firewalls_of_this_machine_are_looked_at() -> None:
    (finding,) = firewall_findings()
    assert (finding.where, finding.what) == ("network", "firewall here")
