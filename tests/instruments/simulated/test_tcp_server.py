from __future__ import annotations

import socket
import threading
import time

import pytest

from benchctl_instruments.errors import UsageError
from benchctl_instruments.links.address import parse_address
from benchctl_instruments.simulated.tcp_server import TcpServer


class Count:
    """Says how many bytes this connection has fed it so far."""

    def __init__(self) -> None:
        self.total = 0

    def feed(self, data: bytes) -> bytes:
        self.total += len(data)
        return b"%d\n" % self.total


class Page:
    """Answers everything with 120 bytes."""

    def feed(self, data: bytes) -> bytes:
        return b"." * 120


def connect(server: TcpServer) -> socket.socket:
    address = parse_address(server.address)
    return socket.create_connection((address.host, address.port), timeout=2.0)


def receive(connection: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        data += connection.recv(count - len(data))
    return data


def threads_of(server: TcpServer) -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if server.address in thread.name]


def test_every_connection_has_a_conversation_of_its_own() -> None:
    with TcpServer(Count) as server, connect(server) as one, connect(server) as other:
        one.sendall(b"12345")
        assert receive(one, 2) == b"5\n"
        other.sendall(b"1")
        assert receive(other, 2) == b"1\n"
        one.sendall(b"12")
        assert receive(one, 2) == b"7\n"


def test_a_client_that_leaves_takes_its_thread_along_and_nobody_elses() -> None:
    with TcpServer(Count) as server, connect(server) as stays:
        with connect(server) as leaves:
            leaves.sendall(b"1")
            receive(leaves, 2)
        deadline_s = time.monotonic() + 5.0
        while len(threads_of(server)) > 2 and time.monotonic() < deadline_s:
            time.sleep(0.005)
        assert len(threads_of(server)) == 2  # the acceptor, and the one that stays
        stays.sendall(b"1")
        assert receive(stays, 2) == b"1\n"


def test_stopping_closes_every_connection_and_leaves_no_thread() -> None:
    server = TcpServer(Count)
    server.start()
    with connect(server) as client:
        client.sendall(b"1")
        receive(client, 2)
        server.stop()
        server.stop()
        assert client.recv(1) == b""
    assert threads_of(server) == []


def test_it_serves_again_at_the_same_address() -> None:
    server = TcpServer(Count)
    with server:
        before = server.address
    with server, connect(server) as client:
        client.sendall(b"1")
        assert receive(client, 2) == b"1\n"
    assert server.address == before
    assert not before.endswith(":0")


def test_a_port_that_is_taken_is_named() -> None:
    with TcpServer(Count) as server:
        port = parse_address(server.address).port
        with pytest.raises(UsageError, match=rf"cannot listen at tcp://127.0.0.1:{port}: .*choose another port"):
            TcpServer(Count, port=port).start()


def test_cut_connections_are_closed_and_new_ones_are_taken() -> None:
    with TcpServer(Count) as server:
        with connect(server) as client:
            client.sendall(b"1")
            receive(client, 2)
            server.cut_connections()
            assert client.recv(1) == b""
        with connect(server) as client:
            client.sendall(b"1")
            assert receive(client, 2) == b"1\n"


def test_paced_bytes_take_as_long_as_on_a_line() -> None:
    with TcpServer(Page, pace_baud=9600) as server, connect(server) as client:
        started_s = time.monotonic()
        client.sendall(b"?")
        receive(client, 12)
        first_s = time.monotonic() - started_s
        receive(client, 108)
        whole_s = time.monotonic() - started_s
    assert 12 * 10 / 9600 * 0.9 < first_s < 0.1
    assert 120 * 10 / 9600 <= whole_s < 0.5


def test_a_paced_server_stops_in_the_middle_of_a_reply() -> None:
    with TcpServer(Page, pace_baud=100) as server, connect(server) as client:
        client.sendall(b"?")
        receive(client, 1)
        started_s = time.monotonic()
        server.stop()
        assert time.monotonic() - started_s < 2.0  # the whole reply would take 12 s
