import socket
from collections import namedtuple

import pytest

from benchctl.doctor.reach import Reached, reach, reach_finding, subnet_of, usual_ports
from benchctl_instruments.links.address import Address, parse_address

snicaddr = namedtuple("snicaddr", "family address netmask broadcast ptp")


def _address(port: int, host: str = "127.0.0.1") -> Address:
    return parse_address(f"tcp://{host}:{port}")


def test_a_port_that_takes_a_connection_is_reached_and_what_it_says_first_is_heard() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert reach("localhost", port).outcome == "connected"
        quiet, _ = server.accept()
        with quiet:
            assert quiet.recv(10) == b""  # nothing was sent
        import threading

        def greet() -> None:
            connection, _ = server.accept()
            with connection:
                connection.sendall(b"SSH-2.0-OpenSSH_9.2\r\n")

        thread = threading.Thread(target=greet)
        thread.start()
        reached = reach("127.0.0.1", port)
        thread.join()
    assert reached == Reached(outcome="connected", host="127.0.0.1", banner=b"SSH-2.0-OpenSSH_9.2\r\n")


def test_a_port_that_refuses_gets_a_hint_of_the_models_usual_one() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    reached = reach("127.0.0.1", port)
    finding = reach_finding("chamber", _address(port), "watlow_f4t", reached)
    assert (finding.verdict, reached.outcome) == ("bad", "refused")
    assert (
        finding.message == f"127.0.0.1, port {port}: the machine is there and refuses that port (this machine itself)"
    )
    assert finding.do.endswith("correct the port; watlow_f4t usually answers at port 502")


def test_a_name_that_nobody_knows_is_told_apart() -> None:
    reached = reach("no-such-instrument.invalid", 502)
    finding = reach_finding("chamber", _address(502, "no-such-instrument.invalid"), "watlow_f4t", reached)
    assert reached.outcome == "unresolved"
    assert finding.message.startswith("no host is named 'no-such-instrument.invalid': ")
    assert "write its number" in finding.do


def test_a_name_that_cannot_be_one_is_told_too() -> None:
    assert reach("a" * 70 + ".invalid", 502).outcome == "unresolved"


def test_who_waits_for_an_answer_waits_no_longer_than_told() -> None:
    with socket.socket() as full:
        full.bind(("127.0.0.1", 0))
        full.listen(0)
        port = full.getsockname()[1]
        queue = [socket.socket() for _ in range(3)]
        for waiting in queue:  # the third has no room, and its packets are dropped
            waiting.setblocking(False)
            waiting.connect_ex(("127.0.0.1", port))
        reached = reach("127.0.0.1", port, connect_s=0.2)
        for waiting in queue:
            waiting.close()
    assert (reached.outcome, reached.detail) == ("no answer", "no answer within 0.2 s")
    finding = reach_finding("chamber", _address(port), "watlow_f4t", reached)
    assert finding.verdict == "bad"
    assert "check power and cable, then the firewalls on both sides" in finding.do


def test_usual_ports_are_known_of_models_that_have_some() -> None:
    assert usual_ports("acutrol3000") == "; acutrol3000 usually answers at port 9888 or 9878"
    assert usual_ports("eurotherm_2400") == ""


def test_the_subnet_is_the_smallest_of_this_machines_that_holds_the_address(monkeypatch: pytest.MonkeyPatch) -> None:
    cards = {
        "eth0": [snicaddr(socket.AF_INET, "192.168.2.5", "255.255.0.0", None, None)],
        "eth1": [snicaddr(socket.AF_INET, "192.168.1.5", "255.255.255.0", None, None)],
        "eth2": [snicaddr(socket.AF_INET6, "fe80::5", None, None, None)],
    }
    monkeypatch.setattr("psutil.net_if_addrs", lambda: cards)
    assert subnet_of("192.168.1.60") == "192.168.1.0/24"
    assert subnet_of("192.168.7.1") == "192.168.0.0/16"
    assert subnet_of("127.0.0.2") == "127.0.0.0/8"
    assert [subnet_of(host) for host in ("8.8.8.8", "fe80::1", "chamber")] == ["", "", ""]
