"""Networks that lead nowhere, made of network namespaces: no route, nobody there, packets dropped, and forbidden."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchctl.bench import template

_TRIAL = "ip link set lo up && ip link add v0 type veth peer name v1"
_WORKS = shutil.which("unshare") and subprocess.run(["unshare", "-n", "sh", "-c", _TRIAL], capture_output=True)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not _WORKS or _WORKS.returncode != 0, reason="this user may not make network namespaces with a cable in them"
    ),
]

CABLE = """\
ip link set lo up
unshare -n sleep 60 &
peer=$!
trap 'kill $peer' EXIT
sleep 0.3
ip link add v0 type veth peer name v1
ip link set v1 netns $peer
ip addr add 10.96.0.1/24 dev v0
ip link set v0 up
nsenter -t $peer -n ip link set v1 up
"""
INSTRUMENT = "nsenter -t $peer -n ip addr add 10.96.0.7/24 dev v1\n"
DROPS = "nsenter -t $peer -n ip route add blackhole 10.96.0.1/32\n"
GATEWAY = "ip route add default via 10.96.0.7\n"


def _doctor(folder: Path, network: str, host: str) -> dict[str, str]:
    """What the doctor finds of a rate table at a host, in a network of its own."""
    text = template().replace("simulated = true", "simulated = false")
    for model, port in (("acutrol3000", 9888), ("watlow_f4t", 502), ("labjack_t7", 502)):
        text = text.replace(f'model = "{model}"', f'model = "{model}"\naddress = "tcp://{host}:{port}"')
    (folder / "bench.toml").write_text(text, encoding="utf-8")
    doctor = f"{sys.executable} -m benchctl doctor --bench {folder}/bench.toml --out {folder} --json {folder}/told.json"
    script = f"set -e\n{network}\n{doctor} || echo status $?"
    ran = subprocess.run(["unshare", "-n", "bash", "-c", script], capture_output=True, text=True, timeout=50)
    assert ran.stdout.endswith("status 3\n"), ran.stdout + ran.stderr
    findings = json.loads((folder / "told.json").read_text())["findings"]
    (found,) = [each for each in findings if (each["where"], each["what"]) == ("rate_table", "connection")]
    assert found["verdict"] == "bad"
    return dict(found)


def test_without_a_route_there_is_no_way(tmp_path: Path) -> None:
    found = _doctor(tmp_path, "ip link set lo up", "10.99.0.7")
    assert "this machine has no route to it (in no subnet of this machine)" in found["says"]
    assert "an address in the instrument's subnet" in found["do"]


def test_an_address_that_nobody_has_is_told_from_one_behind_a_firewall(tmp_path: Path) -> None:
    found = _doctor(tmp_path, CABLE, "10.96.0.9")
    assert "no device in the subnet has that address" in found["says"]
    assert "plug in its cable" in found["do"]


def test_an_instrument_that_is_there_and_drops_packets_is_told_from_an_absent_one(tmp_path: Path) -> None:
    found = _doctor(tmp_path, CABLE + INSTRUMENT + DROPS, "10.96.0.7")
    assert "its network card answers, its port does not" in found["says"]
    assert "a firewall on its side" in found["do"]


def test_an_address_behind_a_gateway_that_forwards_nothing_names_the_gateway(tmp_path: Path) -> None:
    found = _doctor(tmp_path, CABLE + INSTRUMENT + GATEWAY, "10.97.0.7")
    assert "(in no subnet of this machine, reached through a gateway)" in found["says"]


def test_a_route_that_forbids_it_is_this_machines_own(tmp_path: Path) -> None:
    found = _doctor(tmp_path, "ip link set lo up\nip route add prohibit 10.98.0.0/24", "10.98.0.7")
    assert "a firewall or route of this machine does not let it out" in found["says"]
    assert "nft list ruleset" in found["do"]
