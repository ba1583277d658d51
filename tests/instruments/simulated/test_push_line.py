from __future__ import annotations

import os
import socket
import sys
import threading
import time
from collections.abc import Callable

import pytest

from benchctl_instruments.links.address import parse_address
from benchctl_instruments.links.serial_port import ByteLink, byte_link
from benchctl_instruments.simulated.push_line import PushLine

LINES = [
    pytest.param(False, marks=pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")),
    True,
]


class Counting:
    """Sends the next numbers whenever it may, and says what it hears twice."""

    def __init__(self, piece: int) -> None:
        self.piece, self.made, self.lost = piece, 0, 0
        self.may = threading.Event()

    def feed(self, data: bytes) -> bytes:
        return 2 * data

    def due(self) -> bytes:
        if not self.may.is_set():
            return b""
        first, self.made = self.made, self.made + self.piece
        return bytes(number % 251 for number in range(first, self.made))

    def lose(self) -> None:
        self.lost += 1

    def wait(self, timeout_s: float) -> bool:
        return False


def until(true: Callable[[], bool]) -> None:
    give_up_s = time.monotonic() + 10.0
    while not true():
        assert time.monotonic() < give_up_s, "it did not come about"
        time.sleep(0.005)


def opened(line: PushLine) -> ByteLink:
    link = byte_link(line.address)
    link.open(5.0)
    return link


def heard(link: ByteLink, size: int) -> bytes:
    data = b""
    while len(data) < size:
        data += link.receive(size - len(data), 5.0)
    return data


@pytest.mark.parametrize("over_tcp", LINES)
def test_a_device_is_heard_from_its_first_byte_and_answers_meanwhile(over_tcp: bool) -> None:
    device = Counting(300)
    with PushLine(device, baud=9600, over_tcp=over_tcp) as line:
        link = opened(line)
        link.send(b"ab")
        assert heard(link, 4) == b"abab"
        device.may.set()
        assert heard(link, 3000) == bytes(number % 251 for number in range(3000))
        assert line.dropped_bytes == 0
        link.close()


class Late(Counting):
    """Has not come to send three pieces that were due some time ago."""

    left = 3

    def due(self) -> bytes:
        if not self.may.is_set() or not self.left:
            return b""
        self.left -= 1
        return super().due()


@pytest.mark.parametrize("over_tcp", LINES)
def test_what_was_due_before_a_question_is_sent_before_its_answer(over_tcp: bool) -> None:
    device = Late(5)
    with PushLine(device, baud=9600, over_tcp=over_tcp) as line:
        link = opened(line)
        link.send(b"a")
        assert heard(link, 2) == b"aa"
        device.may.set()
        link.send(b"b")
        assert heard(link, 17) == bytes(range(15)) + b"bb"
        link.close()


@pytest.mark.parametrize("over_tcp", LINES)
def test_what_nobody_takes_is_dropped_and_counted_and_does_not_block_the_device(over_tcp: bool) -> None:
    device = Counting(100_000)
    with PushLine(device, baud=9600, over_tcp=over_tcp) as line:
        device.may.set()
        until(lambda: line.dropped_bytes > 100_000)
        link = opened(line)
        kept = heard(link, 1000)
        link.close()
    assert len(kept) == 1000
    assert line.dropped_bytes < device.made
    assert device.lost > 0


@pytest.mark.parametrize("over_tcp", LINES)
def test_a_disturbed_line_is_heard_as_it_was_disturbed(over_tcp: bool) -> None:
    device = Counting(10)
    with PushLine(device, baud=9600, over_tcp=over_tcp) as line:
        line.disturb = lambda data: b"<" + data[:2] + b">"
        link = opened(line)
        link.send(b"x")  # now it is heard
        assert heard(link, 4) == b"<xx>"
        device.may.set()
        assert heard(link, 8) == b"<\x00\x01><\x0a\x0b>"
        link.close()


def test_over_tcp_the_client_that_connected_last_is_the_one_that_hears() -> None:
    device = Counting(10)
    with PushLine(device, baud=9600, over_tcp=True) as line:
        where = parse_address(line.address)
        first = socket.create_connection((where.host, where.port), timeout=5.0)
        first.sendall(b"1")
        assert first.recv(2) == b"11"
        second = socket.create_connection((where.host, where.port), timeout=5.0)
        second.sendall(b"2")
        assert second.recv(2) == b"22"
        assert first.recv(1) == b""  # let go
        second.close()
        first.close()
        device.may.set()
        until(lambda: line.dropped_bytes > 0)


def test_a_line_can_be_opened_again_and_closing_it_twice_does_no_harm() -> None:
    device = Counting(10)
    line = PushLine(device, baud=9600, over_tcp=True)
    line.stop()
    for _ in range(2):
        line.start()
        line.start()
        link = opened(line)
        link.send(b"x")
        assert heard(link, 2) == b"xx"
        link.close()
        line.stop()
        line.stop()


@pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")
def test_a_pseudo_terminal_stays_while_clients_come_and_go() -> None:
    with PushLine(Counting(10), baud=19200, over_tcp=False) as line:
        assert line.address.endswith("?baud=19200")
        for _ in range(3):
            link = opened(line)
            link.send(b"x")
            assert heard(link, 2) == b"xx"
            link.close()
        assert os.path.exists(parse_address(line.address).device)
