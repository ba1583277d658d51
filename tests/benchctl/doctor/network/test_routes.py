from pathlib import Path

import pytest

from benchctl.doctor.network.routes import is_there, route_to

ROUTES = """\
Iface\tDestination\tGateway \tFlags\tRefCnt\tUse\tMetric\tMask\t\tMTU\tWindow\tIRTT
eth0\t00000000\t0102A8C0\t0003\t0\t0\t0\t00000000\t0\t0\t0
eth0\t0002A8C0\t00000000\t0001\t0\t0\t0\t00FFFFFF\t0\t0\t0
eth1\t0001A8C0\t00000000\t0001\t0\t0\t0\t00FFFFFF\t0\t0\t0
eth2\t0000000A\t00000000\t0000\t0\t0\t0\t000000FF\t0\t0\t0
"""
NEIGHBOURS = """\
IP address       HW type     Flags       HW address            Mask     Device
192.168.1.60     0x1         0x2         02:fc:00:00:00:05     *        eth1
192.168.1.61     0x1         0x0         00:00:00:00:00:00     *        eth1
"""


@pytest.fixture
def net(tmp_path: Path) -> Path:
    (tmp_path / "route").write_text(ROUTES)
    (tmp_path / "arp").write_text(NEIGHBOURS)
    return tmp_path


@pytest.mark.parametrize(
    ("host", "way", "says"),
    [
        ("192.168.1.60", "neighbour", "in our subnet 192.168.1.0/24 at eth1"),
        ("8.8.8.8", "gateway", "in no subnet of ours: by eth0 through the gateway 192.168.2.1"),
        ("10.1.2.3", "gateway", "eth0"),  # the route of eth2 is not up
        ("127.0.0.2", "loopback", "this machine itself"),
        ("fe80::1", "unknown", "no route is known here"),
    ],
)
def test_the_way_to_an_address_is_that_of_the_longest_prefix(net: Path, host: str, way: str, says: str) -> None:
    route = route_to(host, net)
    assert route.way == way
    assert says in str(route)


def test_without_a_default_route_there_is_no_way_to_elsewhere(net: Path) -> None:
    (net / "route").write_text("\n".join(line for line in ROUTES.splitlines() if "00000000\t0102" not in line))
    assert route_to("8.8.8.8", net).way == "none"
    assert route_to("8.8.8.8", net / "absent").way == "unknown"


def test_whether_a_neighbour_is_there_is_known_once_it_was_asked(net: Path) -> None:
    assert [is_there(f"192.168.1.{number}", net) for number in (60, 61, 62)] == [True, False, None]
    assert is_there("192.168.1.60", net / "absent") is None
