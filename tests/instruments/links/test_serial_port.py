from __future__ import annotations

import sys
from collections.abc import Iterator

import pytest

from benchctl_instruments.errors import LinkError, UsageError
from benchctl_instruments.links.serial_port import SerialLink, byte_link
from benchctl_instruments.links.tcp import LinkCutError, TcpLink

if sys.platform == "win32":
    pytest.skip("needs pseudo-terminals", allow_module_level=True)

from benchctl_instruments.simulated.serial_line import PtyLine


class Echo:
    """Answers every line with itself, twice where it is told so, and stays silent to `hush`."""

    def feed(self, data: bytes) -> bytes:
        return b"" if data == b"hush\r" else data * (2 if data == b"twice\r" else 1)


@pytest.fixture
def line() -> Iterator[PtyLine]:
    line = PtyLine(Echo(), pace_baud=None)
    line.start()
    yield line
    line.stop()


@pytest.fixture
def link(line: PtyLine) -> Iterator[SerialLink]:
    link = SerialLink(f"serial://{line.port}?baud=9600")
    link.open(1.0)
    yield link
    link.close()


def answer(link: SerialLink, size: int) -> bytes:
    heard = b""
    while len(heard) < size:
        heard += link.receive(4096, 2.0)
    return heard


def test_bytes_go_there_and_back_unchanged(link: SerialLink) -> None:
    every_byte = bytes(range(256))
    link.send(every_byte)
    assert answer(link, 256) == every_byte


def test_a_silent_device_is_a_link_error_that_names_the_address_and_the_time(link: SerialLink) -> None:
    link.send(b"hush\r")
    with pytest.raises(LinkError, match=r"serial:///dev/.*nothing came within 0.05 s"):
        link.receive(64, 0.05)


def test_a_wait_whose_time_is_over_names_no_negative_time(link: SerialLink) -> None:
    with pytest.raises(LinkError, match=r"nothing came within 0.001 s"):
        link.receive(4096, -0.215)


def test_what_came_unasked_is_thrown_away_before_the_next_question(link: SerialLink) -> None:
    link.send(b"twice\r")
    assert link.receive(6, 2.0) == b"twice\r"[: len(b"twice\r")]
    link.send(b"again\r")
    assert answer(link, 6) == b"again\r"


def test_a_link_that_was_given_up_is_opened_anew_by_the_next_send(link: SerialLink) -> None:
    link.cut("given up")
    with pytest.raises(LinkCutError):
        link.receive(1, 0.05)
    link.send(b"back\r")
    assert answer(link, 5) == b"back\r"


def test_a_device_that_was_pulled_out_is_told_in_one_line(line: PtyLine, link: SerialLink) -> None:
    line.stop()

    def ask() -> bytes:
        link.send(b"gone\r")
        return link.receive(64, 0.2)

    with pytest.raises(LinkError, match=r"check the cable|nothing came"):
        ask()
    with pytest.raises(LinkError, match=r"check the cable|cannot be opened"):
        ask()


def test_a_port_that_is_not_there_is_told_with_what_to_do() -> None:
    with pytest.raises(LinkError, match=r"/dev/no-such-port.*cannot be opened.*check that the device is plugged in"):
        SerialLink("serial:///dev/no-such-port").open(1.0)


def test_a_port_in_use_is_refused(line: PtyLine, link: SerialLink) -> None:
    with pytest.raises(LinkError, match="cannot be opened"):
        SerialLink(f"serial://{line.port}").open(1.0)


def test_a_link_that_was_never_opened_is_the_callers_fault(line: PtyLine) -> None:
    with pytest.raises(UsageError, match="open"):
        SerialLink(f"serial://{line.port}").send(b"x")


def test_the_address_chooses_the_link(line: PtyLine) -> None:
    assert isinstance(byte_link(f"serial://{line.port}"), SerialLink)
    assert isinstance(byte_link("tcp://127.0.0.1:1"), TcpLink)
    assert isinstance(byte_link("socket://127.0.0.1:1"), TcpLink)
    with pytest.raises(UsageError, match="expected a serial port"):
        SerialLink("tcp://127.0.0.1:1")
