import pytest
from starlette.datastructures import Headers

from benchctl.dashboard.web.answers import RefusalError
from benchctl.dashboard.web.gate import is_loopback, own_names, refuse_foreign

LOOPBACK, ALL = own_names("127.0.0.1"), own_names("0.0.0.0")


def status(names: frozenset[str], *, origin_matters: bool = True, **headers: str) -> int:
    """With which status a request is refused; 200: it is not."""
    try:
        refuse_foreign(Headers(headers), names, origin_matters=origin_matters)
    except RefusalError as err:
        return err.status
    return 200


@pytest.mark.parametrize("host", ["127.0.0.1:8123", "localhost:9000", "LOCALHOST", "[::1]:8123", "[::1]", "127.0.0.1"])
def test_the_names_of_this_machine_are_ours_at_any_port_for_a_tunnel_has_its_own(host: str) -> None:
    assert status(LOOPBACK, host=host) == 200


@pytest.mark.parametrize(
    "host",
    [
        "",
        "evil.example",
        "evil.example:8123",
        "127.0.0.1.evil.example",
        "localhost.evil.example:80",
        "192.168.1.9:8123",
        "127.0.0.1:x",
        "127.0.0.1:",
        "127.0.0.1:80:80",
        "[::1",
        "::1",
        "[::1]x",
        "user@127.0.0.1:80",
        "127.0.0.1:-1",
    ],
)
def test_any_other_name_is_refused_for_it_may_be_pointed_here(host: str) -> None:
    assert status(LOOPBACK, host=host) == 421


def test_a_request_without_a_host_or_with_two_is_refused() -> None:
    assert status(LOOPBACK) == 421
    two = Headers(raw=[(b"host", b"localhost"), (b"host", b"localhost")])
    with pytest.raises(RefusalError):
        refuse_foreign(two, LOOPBACK, origin_matters=False)


def test_a_server_for_the_network_answers_to_addresses_and_its_own_name_but_to_no_other_name() -> None:
    import socket

    for host in ("192.168.1.9:8123", "[fe80::1]:8123", "localhost:8123", f"{socket.gethostname()}:8123"):
        assert status(ALL, host=host) == 200
    assert status(ALL, host="evil.example:8123") == 421


@pytest.mark.parametrize(
    ("origin", "expected"),
    [
        ("http://localhost:8123", 200),
        ("http://LOCALHOST:8123", 200),
        ("http://localhost:8124", 403),
        ("https://localhost:8123", 403),
        ("http://127.0.0.1:8123", 403),
        ("http://evil.example", 403),
        ("null", 403),
        ("", 403),
    ],
)
def test_where_it_matters_the_origin_is_this_server_by_the_name_it_was_asked_for(origin: str, expected: int) -> None:
    assert status(LOOPBACK, host="localhost:8123", origin=origin) == expected
    assert status(LOOPBACK, host="localhost:8123", origin=origin, origin_matters=False) == 200


@pytest.mark.parametrize(
    ("host", "expected"),
    [("127.0.0.1", True), ("127.1.2.3", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("lab", False)],
)
def test_which_addresses_only_this_machine_reaches(host: str, expected: bool) -> None:
    assert is_loopback(host) is expected
