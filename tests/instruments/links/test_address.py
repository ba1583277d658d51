from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.errors import UsageError
from benchctl_instruments.links.address import Address, parse_address


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("tcp://192.168.1.53:9888", {"scheme": "tcp", "host": "192.168.1.53", "port": 9888}),
        ("tcp://table.lab:9878", {"scheme": "tcp", "host": "table.lab", "port": 9878}),
        ("tcp://[::1]:502", {"scheme": "tcp", "host": "::1", "port": 502}),
        ("socket://127.0.0.1:4001", {"scheme": "socket", "host": "127.0.0.1", "port": 4001}),
        ("serial:///dev/ttyUSB0?baud=19200", {"scheme": "serial", "device": "/dev/ttyUSB0", "baud": 19200}),
        ("serial:///dev/ttyUSB0", {"scheme": "serial", "device": "/dev/ttyUSB0", "baud": None}),
        ("serial://COM3?baud=9600", {"scheme": "serial", "device": "COM3", "baud": 9600}),
    ],
)
def test_an_address_is_taken_apart_and_can_be_shown_again(text: str, expected: dict[str, object]) -> None:
    address = parse_address(text)

    assert {name: getattr(address, name) for name in expected} == expected
    assert str(address) == text


def test_pyserial_opens_a_port_by_its_device_and_a_socket_by_its_url() -> None:
    assert parse_address("serial://COM3?baud=9600").pyserial_url == "COM3"
    assert parse_address("socket://127.0.0.1:4001").pyserial_url == "socket://127.0.0.1:4001"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("192.168.1.53", "no scheme"),
        ("localhost:9888", "unknown scheme 'localhost'"),
        ("gpib://1", "unknown scheme 'gpib'"),
        ("tcp://192.168.1.53", "the port is missing"),
        ("tcp://:9888", "the host is missing"),
        ("tcp://table:0", "the port is missing or 0"),
        ("tcp://table:70000", "out of range"),
        ("tcp://table:acl", "acl"),
        ("tcp://table:9888/axis1", "only host and port are allowed"),
        ("tcp://table:9888?baud=9600", "only host and port are allowed"),
        ("tcp://me@table:9888", "only host and port are allowed"),
        ("serial://?baud=9600", "the device is missing"),
        ("serial://COM3?baud=fast", "baud must be a whole number above 0, not 'fast'"),
        ("serial://COM3?baud=0", "baud must be"),
        ("serial://COM3?parity=E", "unknown setting 'parity'"),
        ("serial://COM3?9600", "bad query field"),
        ("", "no scheme"),
    ],
)
def test_what_is_no_address_is_refused_in_one_line_that_names_the_forms(text: str, complaint: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_address(text)

    message = str(caught.value)
    assert complaint in message
    assert repr(text) in message
    assert "tcp://HOST:PORT" in message
    assert "\n" not in message


@settings(deadline=None)
@given(st.text() | st.from_regex(r"(tcp|serial|socket)://[!-~]*", fullmatch=True))
def test_any_text_is_either_an_address_or_a_usage_error(text: str) -> None:
    try:
        address = parse_address(text)
    except UsageError:
        return
    assert isinstance(address, Address)
    assert address.device if address.scheme == "serial" else address.host and 0 < address.port < 65536
