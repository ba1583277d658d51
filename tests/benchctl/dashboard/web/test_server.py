import socket

import pytest

from benchctl.dashboard.web.server import listening
from benchctl_instruments.errors import UsageError


def test_any_free_port_is_taken_where_none_is_named() -> None:
    with listening("127.0.0.1", 0) as one, listening("127.0.0.1", 0) as other:
        assert one.getsockname()[1] != other.getsockname()[1]


@pytest.mark.parametrize("host", ["203.0.113.7", "256.1.1.1"])
def test_an_address_that_is_not_this_machines_is_said_in_a_line(host: str) -> None:
    with pytest.raises(UsageError, match=host) as caught:
        listening(host, 0)
    assert "\n" not in str(caught.value)


def test_a_port_in_use_is_not_shared() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(UsageError, match=f"--port {port}: is in use by another program"):
            listening("127.0.0.1", port)
