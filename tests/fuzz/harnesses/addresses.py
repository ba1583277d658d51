"""The addresses of instruments, as bench.toml says them."""

from __future__ import annotations

from benchctl_instruments.links.address import parse_address
from tests.fuzz.harness import Harness, refusals


def one_input(data: bytes) -> None:
    text = data.decode("utf-8", "replace")
    with refusals():
        address = parse_address(text)
        assert address.port < 1 << 16
        assert str(address) == text


def seeds() -> list[bytes]:
    return [
        b"tcp://192.168.1.7:502",
        b"tcp://[::1]:502",
        b"serial:///dev/ttyUSB0?baud=19200",
        b"serial://COM3?baud=9600",
        b"socket://box.local:4001",
    ]


HARNESS = Harness(
    name="addresses",
    weight=200,
    one_input=one_input,
    seeds=seeds,
    tokens=(b"serial://", b"?baud=", b"[::", b"@"),
    longest=512,
)
