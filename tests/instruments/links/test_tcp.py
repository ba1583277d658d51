from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator

import pytest

from benchctl_instruments.errors import LinkError, UsageError
from benchctl_instruments.links.modbus import ModbusLink
from benchctl_instruments.links.tcp import LinkCutError, Reconnect, TcpLink
from benchctl_instruments.simulated.tcp_server import TcpServer

AT_ONCE = Reconnect(attempts=2, wait_s=0.01)


class Echo:
    """Sends everything back, except that it answers nothing to SILENCE, and twice to TWICE."""

    def feed(self, data: bytes) -> bytes:
        return {b"SILENCE": b"", b"TWICE": b"TWICETWICE"}.get(data, data)


@pytest.fixture
def server() -> Iterator[TcpServer]:
    with TcpServer(Echo) as running:
        yield running


@pytest.fixture
def link(server: TcpServer) -> Iterator[TcpLink]:
    link = TcpLink(server.address, reconnect=AT_ONCE)
    link.open(2.0)
    yield link
    link.close()


def exchange(link: TcpLink, data: bytes) -> bytes:
    link.send(data)
    reply = b""
    while len(reply) < len(data):
        reply += link.receive(4096, 2.0)
    return reply


def free_address() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp://127.0.0.1:{probe.getsockname()[1]}"


def test_bytes_go_there_and_back_and_into_the_wire_log(link: TcpLink) -> None:
    assert exchange(link, b"ping") == b"ping"
    assert [(entry.direction, entry.data) for entry in link.wire_log.last(2)] == [
        ("sent", b"ping"),
        ("received", b"ping"),
    ]


def test_small_packets_leave_at_once(link: TcpLink) -> None:
    assert link._socket is not None
    assert link._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_no_more_than_asked_for_is_received_at_a_time(link: TcpLink) -> None:
    link.send(b"abcdef")
    assert len(link.receive(4, 2.0)) <= 4


def test_where_nobody_listens_the_address_the_attempts_and_the_advice_are_named() -> None:
    address = free_address()
    with pytest.raises(LinkError, match=rf"{address}: could not connect in 2 attempts.*refused.*check") as caught:
        TcpLink(address, reconnect=AT_ONCE).open(1.0)
    assert not isinstance(caught.value, LinkCutError)


def test_silence_is_a_link_error_after_the_time_that_was_granted(link: TcpLink) -> None:
    link.send(b"SILENCE")
    started_s = time.monotonic()
    with pytest.raises(LinkError, match=r"nothing came within 0.1 s"):
        link.receive(4096, 0.1)
    assert 0.09 < time.monotonic() - started_s < 1.0


def test_a_wait_whose_time_is_over_takes_what_has_come_and_names_no_negative_time(link: TcpLink) -> None:
    with pytest.raises(LinkError, match=r"nothing came within 0.001 s"):
        link.receive(4096, -0.215)


def test_a_cut_in_the_middle_of_a_dialogue_is_said_and_the_next_send_connects_again(
    server: TcpServer, link: TcpLink
) -> None:
    link.send(b"SILENCE")
    cutter = threading.Timer(0.05, server.cut_connections)
    cutter.start()
    with pytest.raises(LinkCutError, match=server.address):
        link.receive(4096, 2.0)
    cutter.join()
    with pytest.raises(LinkCutError, match="nothing can be received"):
        link.receive(4096, 2.0)

    assert exchange(link, b"again") == b"again"


def test_a_cut_while_nobody_used_the_link_costs_nothing(server: TcpServer, link: TcpLink) -> None:
    exchange(link, b"before")
    server.cut_connections()

    assert exchange(link, b"after") == b"after"
    assert any("found closed" in str(entry) for entry in link.wire_log.last(10))


def test_an_instrument_that_was_switched_off_and_on_is_found_again(server: TcpServer, link: TcpLink) -> None:
    server.stop()
    with pytest.raises(LinkError, match="could not connect in 2 attempts"):
        link.send(b"is anybody there")
    server.start()

    assert exchange(link, b"welcome back") == b"welcome back"


def test_what_came_unasked_is_thrown_away_before_the_next_request(link: TcpLink) -> None:
    link.send(b"TWICE")
    link.receive(5, 2.0)
    time.sleep(0.05)

    assert exchange(link, b"fresh") == b"fresh"


def test_a_late_reply_cannot_arrive_on_the_connection_after_a_cut(link: TcpLink) -> None:
    link.send(b"late")
    link.cut("given up")
    assert exchange(link, b"new") == b"new"


def test_a_link_that_is_not_open_is_the_callers_fault(server: TcpServer) -> None:
    link = TcpLink(server.address)
    with pytest.raises(UsageError, match=r"call open\(\) first"):
        link.send(b"x")
    link.open(1.0)
    link.close()
    link.close()
    with pytest.raises(UsageError, match=r"call open\(\) first"):
        link.send(b"x")


def test_only_tcp_addresses_are_taken() -> None:
    with pytest.raises(UsageError, match="tcp://HOST:PORT"):
        TcpLink("serial://COM3?baud=9600")


@pytest.mark.parametrize("timeout_s", [0.0, -1.0, float("inf"), float("nan")])
def test_a_time_for_which_nobody_can_wait_is_refused(server: TcpServer, timeout_s: float) -> None:
    with pytest.raises(UsageError, match=f"{server.address}': a time-out of {timeout_s} s; give a finite one above 0"):
        TcpLink(server.address).open(timeout_s)
    with pytest.raises(UsageError, match=f"a time-out of {timeout_s} s"):
        ModbusLink(server.address, timeout_s=timeout_s)
