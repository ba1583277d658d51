"""The faults of a link as a client sees them, over real sockets and a pseudo-terminal."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from benchctl_instruments.errors import UsageError
from benchctl_instruments.links.address import parse_address
from benchctl_instruments.protocols.modbus import with_crc
from benchctl_instruments.simulated.faults.bench import BenchFaults
from benchctl_instruments.simulated.faults.link_faults import (
    BadChecksum,
    Cut,
    HalfFloat,
    Junk,
    Late,
    LinkFault,
    LostRequest,
    OtherUnit,
    PulledCable,
    Refusal,
    Restart,
    Silence,
    Slow,
    Split,
    TableTrips,
)
from benchctl_instruments.simulated.modbus_server import ModbusRtuServer, ModbusTcpServer
from benchctl_instruments.simulated.serial_line import PtyLine
from benchctl_instruments.simulated.tcp_server import TcpServer
from tests.instruments.modbus_device import Memory

ASK = with_crc(bytes.fromhex("01 03 00 05 00 02"))
TRUE = with_crc(bytes.fromhex("01 03 04 00 05 00 06"))
TCP_ASK = bytes.fromhex("12 34 00 00 00 06 01 03 00 05 00 02")
TCP_TRUE = bytes.fromhex("12 34 00 00 00 07 01 03 04 00 05 00 06")


class Echo:
    """Answers a line with itself, and counts what it has carried out."""

    carried_out = 0

    def feed(self, data: bytes) -> bytes:
        self.carried_out += 1
        return data.upper()


@contextmanager
def served(*faults: LinkFault, server: TcpServer | None = None) -> Iterator[tuple[TcpServer, BenchFaults]]:
    echo = Echo()
    server = server or TcpServer(lambda: echo)
    bench = BenchFaults(faults, lambda: 0.0)
    bench.befall("chamber", server)
    with server:
        yield server, bench


PATIENCE_S = 10.0


def connect(server: TcpServer) -> socket.socket:
    address = parse_address(server.address)
    connection = socket.create_connection((address.host, address.port), timeout=2.0)
    connection.settimeout(2.0)
    return connection


def connected_within(server: TcpServer, patience_s: float) -> socket.socket:
    """A connection, as soon as none is refused any more."""
    give_up_s = time.monotonic() + patience_s
    while True:
        try:
            return connect(server)
        except ConnectionRefusedError:
            if time.monotonic() > give_up_s:
                raise
            time.sleep(0.02)


def until(condition: Callable[[], bool]) -> None:
    """Wait for it, however slow the machine is at the moment."""
    give_up_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up_s, "it did not come about"
        time.sleep(0.01)


def heard(connection: socket.socket, within_s: float = 0.1, *, first: int = 0) -> bytes:
    """What comes within a time, until the other side closes; so many bytes are waited for first, however long."""
    data = b""
    connection.settimeout(PATIENCE_S)
    while len(data) < first and (more := connection.recv(4096)):
        data += more
    connection.settimeout(within_s)
    try:
        while more := connection.recv(4096):
            data += more
    except TimeoutError:
        pass
    return data


RTU_CASES: list[tuple[Callable[..., LinkFault], bytes]] = [
    (Silence, b""),
    (LostRequest, b""),
    (Late, b""),
    (Slow, TRUE),
    (Split, TRUE),
    (OtherUnit, with_crc(bytes.fromhex("02 03 04 00 05 00 06"))),
    (BadChecksum, TRUE[:-1] + bytes([TRUE[-1] ^ 0x10])),
    (HalfFloat, with_crc(bytes.fromhex("01 03 02 00 05"))),
    (Refusal, with_crc(bytes.fromhex("01 83 04"))),
    (Cut, TRUE[:4]),
    (lambda **when: Junk(kind="junk_before", junk="aa bb", **when), b"\xaa\xbb" + TRUE),
    (lambda **when: Junk(kind="junk_in", junk="aa bb", **when), TRUE[:4] + b"\xaa\xbb" + TRUE[4:]),
    (lambda **when: Junk(kind="junk_after", junk="aa bb", **when), TRUE + b"\xaa\xbb"),
    (PulledCable, b""),
]


@pytest.mark.parametrize(("make", "expected"), RTU_CASES)
@pytest.mark.slow
def test_each_kind_on_a_modbus_line_byte_for_byte(make: Callable[..., LinkFault], expected: bytes) -> None:
    server = ModbusRtuServer(Memory(), unit_id=1, over_tcp=True)
    BenchFaults([make(on="chamber", nth=2)], lambda: 0.0).befall("chamber", server)
    with server:
        address = parse_address(server.address)
        with socket.create_connection((address.host, address.port)) as connection:
            connection.sendall(ASK)
            assert heard(connection, first=len(TRUE)) == TRUE
            connection.sendall(ASK)
            assert heard(connection, 0.45, first=len(expected)) == expected


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (OtherUnit, bytes.fromhex("12 34 00 00 00 07 02 03 04 00 05 00 06")),
        (HalfFloat, bytes.fromhex("12 34 00 00 00 05 01 03 02 00 05")),
        (lambda **when: Refusal(code=6, **when), bytes.fromhex("12 34 00 00 00 03 01 83 06")),
        (Cut, TCP_TRUE[:6]),
    ],
)
def test_kinds_that_know_modbus_tcp_byte_for_byte(make: Callable[..., LinkFault], expected: bytes) -> None:
    modbus = ModbusTcpServer(Memory(), unit_id=1)
    with served(make(on="chamber", nth=1), server=modbus) as (server, _), connect(server) as connection:
        connection.sendall(TCP_ASK)
        assert heard(connection, first=len(expected)) == expected


def test_silence_carries_out_and_a_lost_request_does_not() -> None:
    for fault, carried_out in ((Silence(on="chamber"), 1), (LostRequest(on="chamber"), 0)):
        echo = Echo()
        with served(fault, server=TcpServer(lambda echo=echo: echo)) as (server, bench), connect(server) as connection:  # type: ignore[misc]
            connection.sendall(b"a\n")
            until(lambda bench=bench: bool(bench.fired))  # type: ignore[misc]
            assert heard(connection) == b""
            assert echo.carried_out == carried_out


def test_a_late_answer_comes_before_the_answer_to_the_next_request() -> None:
    with served(Late(on="chamber", nth=1)) as (server, _), connect(server) as connection:
        connection.sendall(b"a\n")
        assert heard(connection) == b""
        connection.sendall(b"b\n")
        assert heard(connection, 0.2, first=4) == b"A\nB\n"


def test_a_slow_and_a_split_answer_take_their_time() -> None:
    faults = (Slow(on="chamber", nth=1, delay_s=0.2), Split(on="chamber", nth=2, gap_s=0.2))
    with served(*faults) as (server, _), connect(server) as connection:
        started_s = time.monotonic()
        connection.sendall(b"abcd\n")
        assert connection.recv(10) == b"ABCD\n"
        assert time.monotonic() - started_s >= 0.2
        started_s = time.monotonic()
        connection.sendall(b"abcd\n")
        assert (connection.recv(10), connection.recv(10)) == (b"AB", b"CD\n")
        assert time.monotonic() - started_s >= 0.2


def test_a_cut_ends_its_connection_and_no_other() -> None:
    with served(Cut(on="chamber", pattern="b")) as (server, _), connect(server) as one, connect(server) as other:
        one.sendall(b"bcde\n")
        assert heard(one, first=2) == b"BC"
        assert one.recv(1) == b""
        other.sendall(b"a\n")
        assert heard(other, first=2) == b"A\n"


def test_who_restarts_refuses_connections_for_a_while_and_is_then_at_the_same_port() -> None:
    restarts = Restart(on="chamber", pattern="a", nth=1, for_s=1.0)
    with served(restarts) as (server, _), connect(server) as one, connect(server) as other:
        other.sendall(b"b\n")
        assert other.recv(10) == b"B\n"  # so it has been accepted
        started_s = time.monotonic()
        one.sendall(b"a\n")
        assert (one.recv(1), other.recv(1)) == (b"", b"")
        again = connected_within(server, 10.0)
        assert time.monotonic() - started_s >= 1.0
        with again:
            again.sendall(b"a\n")
            assert heard(again, first=2) == b"A\n"


def test_a_server_is_stopped_while_it_is_away() -> None:
    with served(Restart(on="chamber", nth=1, for_s=30.0)) as (server, _), connect(server) as one:
        one.sendall(b"a\n")
        assert one.recv(1) == b""
        started_s = time.monotonic()
        server.stop()
        assert time.monotonic() - started_s < 2.0


def test_while_the_cable_is_pulled_no_connection_hears_anything() -> None:
    with served(PulledCable(on="chamber", nth=1, for_s=0.3)) as (server, bench), connect(server) as one:
        one.sendall(b"a\n")
        until(lambda: bool(bench.fired))
        with connect(server) as other:
            other.sendall(b"b\n")
            assert (heard(one, 0.05), heard(other, 0.05)) == (b"", b"")
            time.sleep(0.3)
            other.sendall(b"c\n")
            assert heard(other, first=2) == b"C\n"
        assert [fired.kind for fired in bench.fired] == ["pulled_cable"]


def test_requests_that_arrive_together_are_counted_one_by_one() -> None:
    with served(Silence(on="chamber", nth=2)) as (server, bench), connect(server) as connection:
        connection.sendall(b"a\nb\nc\n")
        assert heard(connection, first=4) == b"A\nC\n"
        assert [fired.operation for fired in bench.fired] == ["b"]


def test_of_two_faults_that_are_due_the_first_happens_and_both_have_counted() -> None:
    faults = (Silence(on="chamber", nth=2), Junk(on="chamber", kind="junk_after", junk="21", every=2))
    with served(*faults) as (server, bench), connect(server) as connection:
        for _ in range(4):
            connection.sendall(b"a\n")
            heard(connection, 0.05)
        until(lambda: len(bench.fired) > 1)
    assert [fired.kind for fired in bench.fired] == ["silence", "junk_after"]


def test_what_has_happened_is_noted_with_bench_time_place_and_operation() -> None:
    now_s = [5.0]
    bench = BenchFaults([Silence(on="chamber", from_s=10.0)], lambda: now_s[0])
    echo = Echo()
    server = TcpServer(lambda: echo)
    bench.befall("chamber", server)
    with server, connect(server) as connection:
        connection.sendall(b"a\n")
        assert heard(connection, first=2) == b"A\n"
        now_s[0] = 12.5
        connection.sendall(b"b\n")
        until(lambda: bool(bench.fired))
        assert heard(connection) == b""
    (fired,) = bench.fired
    assert (fired.bench_s, fired.where, fired.kind, fired.operation) == (12.5, "chamber", "silence", "b")


def test_a_pseudo_terminal_has_the_same_faults() -> None:
    line = PtyLine(Echo(), pace_baud=None)
    bench = BenchFaults([Junk(on="chamber", kind="junk_in", junk="21", nth=2)], lambda: 0.0)
    bench.befall("chamber", line)
    line.start()
    try:
        port = os.open(line.port, os.O_RDWR | os.O_NOCTTY)
        for expected in (b"AB\n", b"A!B\n"):
            os.write(port, b"ab\n")
            data = b""
            while len(data) < len(expected):
                data += os.read(port, 100)
            assert data == expected
        os.close(port)
    finally:
        line.stop()


@pytest.mark.parametrize("fault", [BadChecksum(on="chamber"), OtherUnit(on="chamber"), HalfFloat(on="chamber")])
def test_a_fault_that_a_protocol_cannot_have_is_refused_in_one_line(fault: LinkFault) -> None:
    with pytest.raises(UsageError, match=f"faults: {fault.kind} cannot happen to the chamber that was chosen"):
        BenchFaults([fault], lambda: 0.0).befall("chamber", TcpServer(Echo))


def test_a_twin_without_an_interlock_cannot_have_it_opened() -> None:
    trips = TableTrips(on="rate_table", kind="interlock_opened")
    with pytest.raises(UsageError, match="interlock_opened cannot happen to the rate_table that was chosen"):
        BenchFaults([trips], lambda: 0.0).befall("rate_table", TcpServer(Echo))


def test_without_faults_nothing_stands_between_a_server_and_its_conversation() -> None:
    server = TcpServer(Echo)
    BenchFaults([Silence(on="digitizer")], lambda: 0.0).befall("chamber", server)
    assert server.faults is None
